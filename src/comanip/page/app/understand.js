export class Understand {
  constructor(page, box) { this.page = page; this.box = box; }
  enter() {}
  next() {}
  ended() {}
  frame() {}
  draw() {}
}
