/* The world as one robot believes it, over the truth, which is dimmed. */
"use strict";

(function (page) {
  const FADED = 0.3;
  const FADING_TICKS = 30;
  const AXES_95 = Math.sqrt(5.991); // chi-squared with 2 degrees of freedom: 95 % of estimates
  const ERROR_PX_MIN = 6;
  const SPACIOUS_ROBOTS_MAX = 8;

  const shown = (age) => FADED + (1 - FADED) * Math.exp(-age / FADING_TICKS);

  /* The belief of the selected robot at the present tick; null if there is none. */
  page.beliefOf = function (frame, selected) {
    return selected === null ? null : frame.bel[selected];
  };

  function drawGhost(view, [k, x, y, age, planned]) {
    const { ctx, camera, look, moment, model } = view;
    const { colour, shape } = page.robotStyle(k);
    const [px, py] = [camera.x(x), camera.y(y)];
    const [tx, ty] = [camera.x(moment.robots[k][0]), camera.y(moment.robots[k][1])];
    const radius = Math.max(model.stage.radius_m * camera.pxPerM, 6 * look.scale);
    ctx.globalAlpha = shown(age);
    ctx.strokeStyle = colour;
    if (Math.hypot(px - tx, py - ty) > ERROR_PX_MIN) {
      ctx.lineWidth = 1.4;
      ctx.setLineDash([1.5, 3]);
      ctx.beginPath();
      ctx.moveTo(px, py);
      ctx.lineTo(tx, ty);
      ctx.stroke();
    }
    ctx.setLineDash(planned ? [5, 3] : [1.5, 3]);
    ctx.lineWidth = 2;
    ctx.beginPath();
    ctx.arc(px, py, radius, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.setLineDash([]);
    page.drawShape(ctx, shape, px, py, 0.45 * radius, colour, { outline: look.colour("ink") });
    ctx.globalAlpha = Math.max(0.75, shown(age));
    const words = moment.robots.length > SPACIOUS_ROBOTS_MAX ? "" : age === 1 ? " tick" : " ticks";
    const unused = planned ? "" : ", too old";
    view.labels.draw(view, `ghost ${k}`, `${model.stage.robots[k]} · ${age}${words}${unused}`, px, py, radius);
  }

  /* Where a robot takes itself to be, if that is seen to be elsewhere than where it is. */
  function drawItself(view, [x, y]) {
    const { ctx, camera, moment, model, selected } = view;
    const { colour } = page.robotStyle(selected);
    const [px, py] = [camera.x(x), camera.y(y)];
    const [tx, ty] = [camera.x(moment.robots[selected][0]), camera.y(moment.robots[selected][1])];
    if (Math.hypot(px - tx, py - ty) <= ERROR_PX_MIN) return;
    const radius = page.bodyPx(view, model.stage.radius_m);
    ctx.strokeStyle = colour;
    ctx.lineWidth = 2;
    ctx.setLineDash([5, 3]);
    ctx.beginPath();
    ctx.arc(px, py, radius, 0, 2 * Math.PI);
    ctx.moveTo(px, py);
    ctx.lineTo(tx, ty);
    ctx.stroke();
    ctx.setLineDash([]);
    view.labels.draw(view, "itself", `${model.stage.robots[selected]} by itself`, px, py, radius);
  }

  function drawEstimate(view, belief) {
    const { ctx, camera, look, model } = view;
    const [x, y] = [camera.x(belief.e[0]), camera.y(belief.e[1])];
    const radius = Math.max(model.stage.target_radius_m * camera.pxPerM, 6 * look.scale);
    ctx.globalAlpha = 1;
    if (belief.c) {
      // Both axes have one variance, so the ellipse is a circle.
      const axis = AXES_95 * Math.sqrt(Math.max(0, belief.c[0])) * camera.pxPerM;
      ctx.beginPath();
      ctx.ellipse(x, y, axis, axis, 0, 0, 2 * Math.PI);
      ctx.fillStyle = look.colour("late");
      ctx.globalAlpha = 0.18;
      ctx.fill();
      ctx.globalAlpha = 1;
      ctx.strokeStyle = look.colour("late");
      ctx.lineWidth = 1.4;
      ctx.stroke();
    }
    ctx.strokeStyle = look.colour("target");
    ctx.lineWidth = 2;
    ctx.setLineDash([4, 3]);
    ctx.beginPath();
    ctx.arc(x, y, radius, 0, 2 * Math.PI);
    ctx.stroke();
    ctx.setLineDash([]);
    page.drawShape(ctx, "star", x, y, 0.5 * radius, look.colour("target"), { lineWidth: 2 });
    view.labels.draw(view, "estimate", "target, estimated", x, y, radius);
  }

  function drawPrediction(view, belief) {
    const { ctx, camera, look } = view;
    ctx.fillStyle = look.colour("target");
    ctx.globalAlpha = 0.85;
    ctx.strokeStyle = look.colour("target");
    ctx.lineWidth = 0.8;
    ctx.beginPath();
    const way = belief.e ? [belief.e, ...belief.f] : belief.f;
    way.forEach(([x, y], k) => ctx[k ? "lineTo" : "moveTo"](camera.x(x), camera.y(y)));
    ctx.stroke();
    for (const [x, y] of belief.f) {
      ctx.beginPath();
      ctx.arc(camera.x(x), camera.y(y), 2.2, 0, 2 * Math.PI);
      ctx.fill();
    }
  }

  /* The robot itself, ghosts of peers, the estimate of the target with its 95 % ellipse, its prediction as dots. */
  page.drawBelief = function (view, belief) {
    const { ctx, look } = view;
    ctx.font = look.font(12, 600);
    drawPrediction(view, belief);
    drawItself(view, belief.p);
    if (belief.e) drawEstimate(view, belief);
    for (const peer of belief.n) drawGhost(view, peer);
    ctx.globalAlpha = 1;
  };

  /* How far in m a robot's picture of its peers and of the target is from the truth of a tick:
     {peers: [[name, error]], target: error or null}; null without a belief. */
  page.beliefErrors = function (stage, frame, selected) {
    const belief = page.beliefOf(frame, selected);
    if (!belief) return null;
    const off = (x, y, [tx, ty]) => Math.hypot(x - tx, y - ty);
    return {
      peers: belief.n.map(([k, x, y]) => [stage.robots[k], off(x, y, frame.r[k])]),
      target: belief.e ? off(belief.e[0], belief.e[1], frame.g) : null,
    };
  };
})((window.encirclePage = window.encirclePage || {}));
