/* Which part of the plane is seen: all that ever happens, the hunt as it is now, or a view by hand. */
"use strict";

(function (page) {
  const MARGIN_M = 1.6;
  const CLOSE_MARGIN_M = 2;
  const SPAN_M_MIN = 10;
  const BODY_PX_MIN = 8; // A view of all in which bodies are smaller is not the one to begin with.
  const CATCH_UP_HZ = 3;
  const HURRY_HZ = 20; // While something is out of view.
  const ZOOM_PX_PER_M_MAX = 400;
  const [THERE_PX, THERE_SHARE] = [0.25, 1e-3]; // So near it counts as there.

  class Camera {
    constructor() {
      this.mode = "whole";
      this.centre = [0, 0];
      this.pxPerM = 30;
      this.size = [1, 1];
      this.fresh = true;
    }

    setMode(mode) {
      this.mode = mode;
    }

    /* The view to begin with: the whole arena, unless bodies would be tiny in it, or it is not known
       yet how large it will be. */
    begin(model, width, height, live) {
      this.size = [width, height];
      const { pxPerM } = this.fit(wholeBox(model));
      const tiny = pxPerM * model.stage.radius_m < BODY_PX_MIN;
      this.mode = tiny || live ? "close" : "whole";
    }

    /* Moves on by a stretch of time in s, Infinity to be there at once; returns whether it is still
       on its way. */
    update(model, moment, width, height, s) {
      const resized = width !== this.size[0] || height !== this.size[1];
      this.size = [width, height];
      if (this.mode === "free" && !this.fresh) return false;
      const box = this.mode === "close" ? closeBox(moment) : wholeBox(model);
      const goal = this.fit(box);
      const rate = this.shows(box) ? CATCH_UP_HZ : HURRY_HZ;
      if (this.fresh || resized || s === Infinity) {
        Object.assign(this, goal, { fresh: false });
        return false;
      }
      const share = 1 - Math.exp(-rate * s);
      this.centre = page.between(this.centre, goal.centre, share);
      this.pxPerM *= (goal.pxPerM / this.pxPerM) ** share;
      const offPx = this.pxPerM * Math.hypot(this.centre[0] - goal.centre[0], this.centre[1] - goal.centre[1]);
      return offPx > THERE_PX || Math.abs(goal.pxPerM / this.pxPerM - 1) > THERE_SHARE;
    }

    fit([x0, y0, x1, y1]) {
      const [w, h] = this.size;
      const spans = [Math.max(x1 - x0, SPAN_M_MIN), Math.max(y1 - y0, SPAN_M_MIN)];
      return {
        centre: [(x0 + x1) / 2, (y0 + y1) / 2],
        pxPerM: Math.min(w / spans[0], h / spans[1]),
      };
    }

    /* Whether a box is in view, but for half a margin. */
    shows([x0, y0, x1, y1]) {
      const [left, top] = this.place(0, 0);
      const [right, bottom] = this.place(...this.size);
      const slack = CLOSE_MARGIN_M / 2;
      return x0 + slack >= left && y0 + slack >= bottom && x1 - slack <= right && y1 - slack <= top;
    }

    x(xM) {
      return this.size[0] / 2 + (xM - this.centre[0]) * this.pxPerM;
    }

    y(yM) {
      return this.size[1] / 2 - (yM - this.centre[1]) * this.pxPerM;
    }

    /* The place in m of a point on the canvas. */
    place(x, y) {
      return [
        this.centre[0] + (x - this.size[0] / 2) / this.pxPerM,
        this.centre[1] - (y - this.size[1] / 2) / this.pxPerM,
      ];
    }

    /* Zooms by a factor about a point of the canvas. */
    zoom(factor, x, y) {
      const [px, py] = this.place(x, y);
      this.mode = "free";
      this.pxPerM = Math.min(this.pxPerM * factor, ZOOM_PX_PER_M_MAX);
      this.centre[0] = px - (x - this.size[0] / 2) / this.pxPerM;
      this.centre[1] = py + (y - this.size[1] / 2) / this.pxPerM;
    }

    pan(dx, dy) {
      this.mode = "free";
      this.centre = [this.centre[0] - dx / this.pxPerM, this.centre[1] + dy / this.pxPerM];
    }
  }

  function around(points, margin) {
    const [xs, ys] = [points.map((p) => p[0]), points.map((p) => p[1])];
    return [
      Math.min(...xs) - margin,
      Math.min(...ys) - margin,
      Math.max(...xs) + margin,
      Math.max(...ys) + margin,
    ];
  }

  function wholeBox(model) {
    const [x0, y0, x1, y1] = model.bounds || [-5, -5, 5, 5];
    const corners = [[x0, y0], [x1, y1]];
    for (const [x, y, r] of model.stage.obstacles) corners.push([x - r, y - r], [x + r, y + r]);
    return around(corners, MARGIN_M);
  }

  function closeBox(moment) {
    return around([...moment.robots, moment.target], CLOSE_MARGIN_M);
  }

  page.Camera = Camera;
})((window.encirclePage = window.encirclePage || {}));
