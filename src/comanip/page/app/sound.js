// Force as a low hum, an end as two notes, a HOLD as a thud. Silent until somebody asks for it.

export class Sound {
  constructor() { this.on = false; }

  toggle() {
    this.on = !this.on;
    if (this.on && !this.context) this.start();
    this.context?.[this.on ? "resume" : "suspend"]();
    return this.on;
  }

  start() {
    const Context = globalThis.AudioContext ?? globalThis.webkitAudioContext;
    if (!Context) return;
    this.context = new Context();
    this.hum = this.context.createOscillator();
    this.hum.type = "triangle";
    this.hum.frequency.value = 92;
    this.loud = this.context.createGain();
    this.loud.gain.value = 0;
    const soft = this.context.createBiquadFilter();
    soft.frequency.value = 420;
    this.hum.connect(soft).connect(this.loud).connect(this.context.destination);
    this.hum.start();
  }

  // newtons, and how fast the hand goes [m/s]
  force(newtons, speed) {
    if (!this.on || !this.context) return;
    const now = this.context.currentTime;
    this.loud.gain.setTargetAtTime(Math.min(newtons / 20, 1) * 0.14, now, 0.04);
    this.hum.frequency.setTargetAtTime(92 + 160 * Math.min(speed, 0.6) + 3 * newtons, now, 0.05);
  }

  note(hertz, after = 0, seconds = 0.35, loud = 0.12) {
    if (!this.on || !this.context) return;
    const at = this.context.currentTime + after, tone = this.context.createOscillator(), gain = this.context.createGain();
    tone.frequency.value = hertz;
    gain.gain.setValueAtTime(0, at);
    gain.gain.linearRampToValueAtTime(loud, at + 0.02);
    gain.gain.exponentialRampToValueAtTime(0.001, at + seconds);
    tone.connect(gain).connect(this.context.destination);
    tone.start(at);
    tone.stop(at + seconds);
  }

  arrived() { this.note(523); this.note(784, 0.12, 0.5); }
  missed() { this.note(262, 0, 0.4, 0.08); }
  held() { this.note(70, 0, 0.25, 0.3); }
}
