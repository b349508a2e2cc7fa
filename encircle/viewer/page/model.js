/* What the page knows of the run: stage, frames by tick, status, and what follows from them. */
"use strict";

(function (page) {
  const STATUS = { state: "waiting", text: "", complete: true, beliefs: true, control: false };

  class Model {
    constructor() {
      this.listeners = [];
      this.clear(null);
      this.status = { ...STATUS };
    }

    clear(stage) {
      this.stage = stage;
      this.frames = [];
      this.first = null;
      this.events = [];
      this.sums = [];
      this.bounds = null;
      this.captureTick = null; // the tick of the capture; null if the page has none
      this.hasBeliefs = false;
      this.longestFlight = 1;
      this.version = (this.version || 0) + 1;
    }

    /* Takes one message of a source in and tells the listeners which of its parts it had. */
    take(message) {
      if (message.stage) this.takeStage(message.stage);
      if (message.frames) for (const frame of message.frames) this.takeFrame(frame);
      if (message.status) Object.assign(this.status, message.status);
      for (const listener of this.listeners) listener(message);
    }

    takeStage(stage) {
      const same = this.stage && this.stage.run === stage.run && this.stage.seed === stage.seed;
      if (!same) this.clear(stage);
      this.stage = stage;
    }

    takeFrame(frame) {
      if (!this.stage) return;
      const known = frame.t in this.frames;
      this.frames[frame.t] = frame;
      this.first = this.first === null ? frame.t : Math.min(this.first, frame.t);
      if (known) this.events = this.events.filter((event) => event.tick !== frame.t);
      for (const [kind, text, robots] of frame.ev) {
        this.events.push({ tick: frame.t, kind, text, robots });
      }
      if (known) this.events.sort((a, b) => a.tick - b.tick);
      if (frame.cap && (this.captureTick === null || frame.t < this.captureTick)) this.captureTick = frame.t;
      this.hasBeliefs = this.hasBeliefs || frame.bel.some((belief) => belief);
      this.sums.length = Math.min(this.sums.length, frame.t + 1);
      for (const [, , due, copyDue] of frame.pk) {
        this.longestFlight = Math.max(this.longestFlight, due - frame.t, copyDue - frame.t);
      }
      for (const [x, y] of [...frame.r, frame.g]) this.widen(x, y);
    }

    widen(x, y) {
      const b = this.bounds || (this.bounds = [x, y, x, y]);
      b[0] = Math.min(b[0], x);
      b[1] = Math.min(b[1], y);
      b[2] = Math.max(b[2], x);
      b[3] = Math.max(b[3], y);
    }

    get hasFrames() {
      return this.frames.length > 0;
    }

    /* The first tick that the page has: not 0 if who looks on came late. */
    get firstTick() {
      return this.first === null ? 0 : this.first;
    }

    /* The last tick that the page has. */
    get lastTick() {
      return Math.max(0, this.frames.length - 1);
    }

    /* The frame of a tick, or of the nearest one before that the page has; null without any. */
    frameAt(tick) {
      for (let t = Math.min(tick, this.lastTick); t >= 0; t -= 1) {
        if (this.frames[t]) return this.frames[t];
      }
      return this.frames[this.firstTick] || null;
    }

    /* What a feed should go on with: the run, and the tick after the last one that the page has. */
    position() {
      return { run: this.stage ? this.stage.run : null, from: this.frames.length };
    }

    /* The names of all fates: "arrived", "late", and each cause of loss, by its code plus one. */
    get fates() {
      return ["arrived", "late", ...(this.stage ? this.stage.causes.slice(1) : [])];
    }

    /* The index in fates of a packet that was sent at a tick. */
    fateOf(sentTick, due) {
      if (due < 0) return 1 - due;
      return due > sentTick + 1 ? 1 : 0;
    }

    /* How many packets, and copies of packets, that were sent before a tick have each fate. */
    fateCounts(tick) {
      const { sums } = this;
      if (!sums.length) sums.push(new Int32Array(this.fates.length));
      const last = Math.min(tick, this.frames.length);
      for (let t = sums.length; t <= last; t += 1) {
        const sum = Int32Array.from(sums[t - 1]);
        const frame = this.frames[t - 1];
        if (frame) {
          for (const [, , due, copyDue] of frame.pk) {
            sum[this.fateOf(t - 1, due)] += 1;
            if (copyDue > 0) sum[this.fateOf(t - 1, copyDue)] += 1;
          }
        }
        sums.push(sum);
      }
      return sums[Math.max(0, last)];
    }

    /* Calls draw(sentTick, packet, due, fate) for each packet on its way at a time in ticks: sent
       before it, not arrived before it. A lost one is on its way for the tick after it was sent. */
    eachInFlight(time, draw) {
      const newest = Math.ceil(time) - 1;
      for (let t = Math.max(0, newest - this.longestFlight + 1); t <= newest; t += 1) {
        const frame = this.frames[t];
        if (!frame) continue;
        for (const packet of frame.pk) {
          const due = packet[2];
          if (due < 0 ? time <= t + 1 : time <= due) draw(t, packet, due, this.fateOf(t, due));
          if (packet[3] > 0 && time <= packet[3]) {
            draw(t, packet, packet[3], this.fateOf(t, packet[3]));
          }
        }
      }
    }
  }

  page.Model = Model;
})((window.encirclePage = window.encirclePage || {}));
