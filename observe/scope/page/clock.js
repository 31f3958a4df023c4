// The instant that is shown: it follows the recording, stands, or moves slowly through what is in memory.

const SOFT = 0.06; // how much of a difference is made up for with each block that comes

export class Clock {
  constructor() {
    this.reset();
    this.listeners = new Set();
  }

  reset() {
    this.live = true;
    this.now = 0; // the instant, in seconds of the recording
    this.speed = 0; // while it is not live
    this.latest = 0; // the last that is known
    this.offset = null; // of the recording's clock to the browser's, smoothed
    this.frame = null;
    this.isOver = false;
  }

  // Something has come.
  knows(time) {
    if (time <= this.latest && this.offset !== null) return;
    this.latest = time;
  }

  // All that was on its way has been taken.
  settle(at) {
    const offset = this.latest - at / 1000;
    const difference = offset - this.offset;
    this.offset = this.offset === null || Math.abs(difference) > 0.5 ? offset : this.offset + SOFT * difference;
  }

  // A frame is drawn.
  advance(at) {
    const elapsed = this.frame === null ? 0 : Math.min(0.1, (at - this.frame) / 1000);
    this.frame = at;
    if (!this.live) {
      if (this.speed > 0) {
        this.now = Math.min(this.latest, this.now + elapsed * this.speed);
        if (this.now === this.latest) this.speed = 0;
      }
      return;
    }
    if (this.offset === null) return;
    const wanted = Math.min(this.latest, at / 1000 + this.offset);
    // Never back, but where another recording began.
    this.now = wanted < this.now - 1 ? wanted : Math.max(this.now, wanted);
  }

  pause(at = this.now) {
    this.live = false;
    this.speed = 0;
    this.now = at;
    this.changed();
  }

  follow() {
    this.live = true;
    this.speed = 0;
    this.offset = null;
    this.changed();
  }

  changed() { for (const listener of this.listeners) listener(this); }
}
