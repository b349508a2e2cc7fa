/* How fast the page draws: times between frames on screen, and what drawing one takes. */
"use strict";

(function (page) {
  const KEPT_MAX = 3000;

  const quantile = (sorted, share) =>
    sorted.length ? sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] : null;

  class Stats {
    constructor() {
      this.reset();
    }

    reset() {
      this.intervals = [];
      this.draws = [];
      this.packetsMax = 0;
    }

    /* Takes in one frame: ms since the one before (null after a pause), ms of drawing, packets. */
    record(intervalMs, drawMs, packets) {
      if (intervalMs !== null) this.intervals.push(intervalMs);
      this.draws.push(drawMs);
      this.packetsMax = Math.max(this.packetsMax, packets);
      if (this.draws.length > KEPT_MAX) this.draws.shift();
      if (this.intervals.length > KEPT_MAX) this.intervals.shift();
    }

    /* Frames a second over all intervals, quantiles of intervals and of drawing in ms. */
    summary() {
      const intervals = [...this.intervals].sort((a, b) => a - b);
      const draws = [...this.draws].sort((a, b) => a - b);
      const total = intervals.reduce((sum, value) => sum + value, 0);
      return {
        frames: draws.length,
        frames_per_s: total ? (1000 * intervals.length) / total : null,
        interval_ms_median: quantile(intervals, 0.5),
        interval_ms_p95: quantile(intervals, 0.95),
        draw_ms_median: quantile(draws, 0.5),
        draw_ms_p95: quantile(draws, 0.95),
        packets_max: this.packetsMax,
      };
    }
  }

  page.Stats = Stats;
})((window.encirclePage = window.encirclePage || {}));
