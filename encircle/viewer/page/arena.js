/* The arena: grid, obstacles, trails, ring, goals. All functions draw on the view's ctx.

A view has: ctx, width, height, look, camera, labels, model, moment, layers (what is switched on),
selected (index of a robot, or null), belief (the picked robot's, or null), showsBelief. */
"use strict";

(function (page) {
  const TRAIL_TICKS = 120;
  const { DIMMED } = page;
  const RING_MISFIT_M_MAX = 0.5;
  const RING_RADIUS_M_MAX = 30;

  function niceStep(least) {
    const power = 10 ** Math.floor(Math.log10(least));
    return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= least);
  }

  /* Lines at round distances. */
  page.drawGrid = function (view) {
    const { ctx, camera, look, width, height } = view;
    const step = niceStep(56 / camera.pxPerM);
    const [left, top] = camera.place(0, 0);
    const [right, bottom] = camera.place(width, height);
    ctx.beginPath();
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      ctx.moveTo(camera.x(x), 0);
      ctx.lineTo(camera.x(x), height);
    }
    for (let y = Math.ceil(bottom / step) * step; y <= top; y += step) {
      ctx.moveTo(0, camera.y(y));
      ctx.lineTo(width, camera.y(y));
    }
    ctx.strokeStyle = look.colour("grid");
    ctx.lineWidth = 1;
    ctx.stroke();
  };

  /* A bar with its length in m. */
  page.drawScaleBar = function (view) {
    const { ctx, camera, look, height } = view;
    const step = niceStep(56 / camera.pxPerM);
    const length = step * camera.pxPerM;
    ctx.strokeStyle = look.colour("muted");
    ctx.lineWidth = 2;
    ctx.beginPath();
    ctx.moveTo(12, height - 16);
    ctx.lineTo(12, height - 12);
    ctx.lineTo(12 + length, height - 12);
    ctx.lineTo(12 + length, height - 16);
    ctx.stroke();
    ctx.font = look.font(12);
    ctx.textAlign = "left";
    ctx.textBaseline = "bottom";
    const text = `${Number(step.toPrecision(3))} m`;
    page.drawLabel(ctx, text, 18, height - 14, look.colour("muted"), look.colour("background"));
  };

  page.drawObstacles = function (view) {
    const { ctx, camera, look } = view;
    for (const [x, y, r] of view.model.stage.obstacles) {
      ctx.beginPath();
      ctx.arc(camera.x(x), camera.y(y), r * camera.pxPerM, 0, 2 * Math.PI);
      ctx.fillStyle = look.colour("obstacle");
      ctx.fill();
      ctx.strokeStyle = look.colour("muted");
      ctx.lineWidth = 1;
      ctx.stroke();
    }
  };

  function trail(view, placeOf, end) {
    const { ctx, camera, model, moment } = view;
    let pen = false;
    ctx.beginPath();
    for (let t = Math.max(0, moment.tick - TRAIL_TICKS); t <= moment.tick; t += 1) {
      const frame = model.frames[t];
      if (!frame) continue;
      const [x, y] = placeOf(frame);
      const jump = placeOf === targetOf && frame.ev.some(([kind]) => kind === "moved");
      ctx[pen && !jump ? "lineTo" : "moveTo"](camera.x(x), camera.y(y));
      pen = true;
    }
    if (pen) ctx.lineTo(camera.x(end[0]), camera.y(end[1]));
    ctx.stroke();
  }

  const targetOf = (frame) => frame.g;

  /* Where everyone came from, over the last ticks. */
  page.drawTrails = function (view) {
    const { ctx, look, moment } = view;
    ctx.lineJoin = "round";
    ctx.lineWidth = 1.6;
    ctx.globalAlpha = view.showsBelief ? DIMMED : 0.75;
    moment.robots.forEach((end, k) => {
      const { colour, dash } = page.robotStyle(k);
      ctx.strokeStyle = colour;
      ctx.setLineDash(moment.robots.length > 8 ? [] : dash);
      trail(view, (frame) => frame.r[k], end);
    });
    ctx.setLineDash([]);
    ctx.lineWidth = 2;
    ctx.strokeStyle = look.colour("target");
    trail(view, targetOf, moment.target);
    ctx.globalAlpha = 1;
  };

  /* The circle through the goals of those that encircle, if they have one circle in common: centre
     and radius in m, or null. Least squares in x^2 + y^2 = a x + b y + c. */
  page.commonRing = function (goals) {
    if (goals.length < 3) return null;
    const n = goals.length;
    const mean = [0, 1].map((axis) => goals.reduce((sum, g) => sum + g[axis], 0) / n);
    let [sxx, sxy, syy, sxz, syz, sz] = [0, 0, 0, 0, 0, 0];
    for (const goal of goals) {
      const [x, y] = [goal[0] - mean[0], goal[1] - mean[1]];
      const z = x * x + y * y;
      sxx += x * x;
      sxy += x * y;
      syy += y * y;
      sxz += x * z;
      syz += y * z;
      sz += z;
    }
    const determinant = sxx * syy - sxy * sxy;
    if (determinant < 1e-6) return null;
    const cx = (sxz * syy - syz * sxy) / (2 * determinant);
    const cy = (syz * sxx - sxz * sxy) / (2 * determinant);
    const radius = Math.sqrt(cx * cx + cy * cy + sz / n);
    const centre = [mean[0] + cx, mean[1] + cy];
    const misfit = Math.max(
      ...goals.map((g) => Math.abs(Math.hypot(g[0] - centre[0], g[1] - centre[1]) - radius)),
    );
    return misfit <= RING_MISFIT_M_MAX && radius <= RING_RADIUS_M_MAX ? { centre, radius } : null;
  };

  function circle(view, [x, y], radius) {
    const { ctx, camera } = view;
    ctx.beginPath();
    ctx.arc(camera.x(x), camera.y(y), radius * camera.pxPerM, 0, 2 * Math.PI);
    ctx.stroke();
  }

  /* The stop distance about the target, the ring of encirclement points, and how far the picked
     robot senses. */
  page.drawRings = function (view) {
    const { ctx, look, moment, model } = view;
    ctx.globalAlpha = view.showsBelief ? DIMMED : 1;
    ctx.strokeStyle = look.colour("target");
    ctx.lineWidth = moment.frame.cap ? 3 : 1;
    circle(view, moment.target, model.stage.stop_distance_m);
    const goals = moment.frame.goal.filter((goal, k) => goal && moment.frame.pt[k] !== null);
    const ring = page.commonRing(goals);
    if (ring) {
      ctx.strokeStyle = look.colour("ring");
      ctx.lineWidth = 1.6;
      ctx.setLineDash([2, 4]);
      circle(view, ring.centre, ring.radius);
      ctx.setLineDash([]);
    }
    ctx.globalAlpha = 1;
    if (view.selected !== null) {
      ctx.strokeStyle = page.robotStyle(view.selected).colour;
      ctx.lineWidth = 1;
      ctx.globalAlpha = 0.6;
      circle(view, moment.robots[view.selected], model.stage.sensing_ranges_m[view.selected]);
      ctx.globalAlpha = 1;
    }
  };

  /* Each robot's goal, and the line to it. */
  page.drawGoals = function (view) {
    const { ctx, camera, look, moment } = view;
    ctx.lineWidth = 1.4;
    moment.frame.goal.forEach((goal, k) => {
      if (!goal) return;
      const own = !view.showsBelief || k === view.selected;
      const [x, y] = [camera.x(goal[0]), camera.y(goal[1])];
      ctx.globalAlpha = own ? 0.9 : DIMMED;
      ctx.strokeStyle = page.robotStyle(k).colour;
      ctx.setLineDash([3, 4]);
      ctx.beginPath();
      ctx.moveTo(camera.x(moment.robots[k][0]), camera.y(moment.robots[k][1]));
      ctx.lineTo(x, y);
      ctx.stroke();
      ctx.setLineDash([]);
      ctx.fillStyle = look.colour("background");
      ctx.beginPath();
      ctx.arc(x, y, 4, 0, 2 * Math.PI);
      ctx.fill();
      ctx.stroke();
    });
    ctx.globalAlpha = 1;
  };
})((window.encirclePage = window.encirclePage || {}));
