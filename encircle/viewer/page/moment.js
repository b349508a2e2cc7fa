/* The truth at a moment between two ticks, for drawing. At a tick it is exact. */
"use strict";

(function (page) {
  const mix = (a, b, share) => a + (b - a) * share;
  const between = (p, q, share) => [mix(p[0], q[0], share), mix(p[1], q[1], share)];

  /* Turns the short way round from one angle to another. */
  function turned(a, b, share) {
    const turn = Math.atan2(Math.sin(b - a), Math.cos(b - a));
    return a + turn * share;
  }

  /* Frame and positions in m at a time in ticks; null before there is a frame. A target that is
     moved by hand stays where it was until the tick at which it stands elsewhere. */
  page.momentAt = function (model, time) {
    const tick = Math.floor(time + 1e-9);
    const frame = model.frameAt(tick);
    if (!frame) return null;
    const share = Math.max(0, time - tick);
    const next = share > 1e-6 ? model.frames[tick + 1] : null;
    if (!next) {
      return { tick, time, frame, robots: frame.r, headings: frame.h, target: frame.g };
    }
    const moved = next.ev.some(([kind]) => kind === "moved");
    return {
      tick,
      time,
      frame,
      robots: frame.r.map((p, k) => between(p, next.r[k], share)),
      headings: frame.h.map((h, k) => turned(h, next.h[k], share)),
      target: moved ? frame.g : between(frame.g, next.g, share),
    };
  };

  page.between = between;
})((window.encirclePage = window.encirclePage || {}));
