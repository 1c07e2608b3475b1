/* A block of numbers that C and Python share is written once here, as X(field in C, name in Python) in the order of memory.
 * `layouts()` tells the names, and kernels/layouts.py compares them with Python's own when the module is imported.
 */

#define ONE_NUMBER(field, name) double field;
#define ITS_NAME(field, name) #name " "

typedef struct { const char *block, *names; } Layout;
