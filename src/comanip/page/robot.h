/* What a learned skill does in the page: nothing yet. */
static void skill_free(World *w) { (void)w; }
static int skill_take(World *w, double *numbers, int n) { (void)w, (void)numbers, (void)n; return 0; }
static void skill_begin(World *w) { (void)w; }
static void skill_tick(World *w) { (void)w; }
static int skill_rearm_world(World *w) { (void)w; return 0; }
static const char *skill_reason(int reason) { (void)reason; return ""; }
static int skill_shown(World *w, int what, double *out) { (void)w, (void)what, (void)out; return 0; }
