/* The page's time: a position in ticks that plays, pauses, is set, or follows the newest tick. */
"use strict";

(function (page) {
  const FOLLOW_RATE_HZ = 6;
  const FOLLOW_TICKS_MAX = 40;
  page.SPEEDS = [0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10];

  class Player {
    constructor(model) {
      this.model = model;
      this.time = 0;
      this.playing = false;
      this.following = false;
      this.speed = 0.5;
      this.changed = () => {};
    }

    /* The present tick: a whole number. */
    get tick() {
      return Math.floor(this.time + 1e-9);
    }

    get moving() {
      return this.playing || (this.following && this.time < this.model.lastTick);
    }

    play() {
      if (this.time >= this.model.lastTick && !this.following) this.time = this.model.firstTick;
      this.following = false;
      this.playing = true;
      this.changed();
    }

    pause() {
      this.playing = false;
      this.following = false;
      this.changed();
    }

    toggle() {
      if (this.playing || this.following) this.pause();
      else this.play();
    }

    /* Goes to a tick, or the nearest that there is. */
    seek(tick) {
      this.following = false;
      this.time = Math.min(Math.max(this.model.firstTick, tick), this.model.lastTick);
      this.changed();
    }

    /* Pauses, and goes on or back by whole ticks. */
    step(ticks) {
      this.playing = false;
      this.seek((ticks < 0 ? Math.ceil(this.time) : this.tick) + ticks);
    }

    follow() {
      this.playing = false;
      this.following = true;
      this.changed();
    }

    setSpeed(speed) {
      this.speed = speed;
      this.changed();
    }

    /* One speed slower (-1) or faster (1). */
    changeSpeed(by) {
      const at = page.SPEEDS.indexOf(this.speed) + by;
      this.setSpeed(page.SPEEDS[Math.min(Math.max(0, at), page.SPEEDS.length - 1)]);
    }

    /* Lets a stretch of real time in s pass. */
    advance(s) {
      const last = this.model.lastTick;
      if (this.following) {
        const behind = last - this.time;
        const near = behind < 0.02 || behind > FOLLOW_TICKS_MAX;
        this.time = near ? last : this.time + behind * (1 - Math.exp(-FOLLOW_RATE_HZ * s));
        if (near && this.model.status.state === "ended") this.pause();
      } else if (this.playing && this.model.stage) {
        this.time += (s * this.speed) / this.model.stage.tick_s;
        if (this.time >= last) {
          this.time = last;
          // A live run may go on, and a recording be read on: the page waits at its edge.
          this.playing = this.model.status.state !== "ended";
          this.changed();
        }
      }
    }
  }

  page.Player = Player;
})((window.encirclePage = window.encirclePage || {}));
