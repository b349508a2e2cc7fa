/* Bodies: robots with heading and name, the target with its star. */
"use strict";

(function (page) {
  const BODY_PX_MIN = 5;
  const DIMMED = 0.34; // How strong the truth is behind a belief.
  const NAMED_ROBOTS_MAX = 32;

  page.DIMMED = DIMMED;

  /* The radius in px with which a body is drawn. */
  function bodyPx(view, radius) {
    return Math.max(radius * view.camera.pxPerM, BODY_PX_MIN * view.look.scale);
  }

  page.bodyPx = bodyPx;

  function drawRobot(view, k) {
    const { ctx, camera, look, moment, model } = view;
    const { colour, shape } = page.robotStyle(k);
    const [x, y] = [camera.x(moment.robots[k][0]), camera.y(moment.robots[k][1])];
    const radius = bodyPx(view, model.stage.radius_m);
    const lost = moment.frame.lost[k];
    ctx.beginPath();
    ctx.arc(x, y, radius, 0, 2 * Math.PI);
    ctx.fillStyle = look.colour("background");
    ctx.fill();
    ctx.strokeStyle = lost ? look.colour("muted") : colour;
    ctx.lineWidth = 2;
    if (lost) ctx.setLineDash([3, 3]);
    ctx.stroke();
    ctx.setLineDash([]);
    const angle = -moment.headings[k];
    ctx.beginPath();
    ctx.moveTo(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
    ctx.lineTo(x + 1.6 * radius * Math.cos(angle), y + 1.6 * radius * Math.sin(angle));
    ctx.lineWidth = 3;
    ctx.stroke();
    if (lost) page.drawShape(ctx, "x", x, y, 0.75 * radius, look.colour("muted"), { lineWidth: 2.4 });
    else page.drawShape(ctx, shape, x, y, 0.55 * radius, colour, { outline: look.colour("ink") });
    if (k === view.selected) {
      ctx.beginPath();
      ctx.arc(x, y, radius + 5, 0, 2 * Math.PI);
      ctx.strokeStyle = look.colour("ink");
      ctx.lineWidth = 2;
      ctx.stroke();
    }
  }

  function drawName(view, k) {
    const { camera, moment, model } = view;
    const radius = bodyPx(view, model.stage.radius_m);
    const { lost, sil } = moment.frame;
    const state = lost[k] ? " lost" : sil[k] ? " silent" : "";
    const [x, y] = [camera.x(moment.robots[k][0]), camera.y(moment.robots[k][1])];
    view.labels.draw(view, `body ${k}`, `${model.stage.robots[k]}${state}`, x, y, radius);
  }

  function drawTarget(view) {
    const { ctx, camera, look, moment, model } = view;
    const [x, y] = [camera.x(moment.target[0]), camera.y(moment.target[1])];
    const radius = bodyPx(view, model.stage.target_radius_m);
    ctx.beginPath();
    ctx.arc(x, y, radius, 0, 2 * Math.PI);
    ctx.fillStyle = look.colour("target");
    ctx.fill();
    ctx.beginPath();
    for (let k = 0; k < 10; k += 1) {
      const r = (k % 2 ? 0.36 : 0.86) * radius;
      const angle = (Math.PI * k) / 5 - Math.PI / 2;
      ctx[k ? "lineTo" : "moveTo"](x + r * Math.cos(angle), y + r * Math.sin(angle));
    }
    ctx.closePath();
    ctx.fillStyle = look.colour("background");
    ctx.fill();
  }

  /* Labels leave bodies free, of a belief the ghosts. */
  function keepLabelsOff(view) {
    const { camera, labels, moment, model, belief } = view;
    const places = belief
      ? [moment.robots[view.selected], ...belief.n.map(([, x, y]) => [x, y]), belief.e || []]
      : [...moment.robots, moment.target];
    const radius = 0.8 * bodyPx(view, model.stage.radius_m);
    for (const [x, y] of places.filter((place) => place.length)) labels.keepOff(camera.x(x), camera.y(y), radius);
  }

  /* Robots with heading and name, and the target: a disc with a star. Discs are to scale, unless
     they would be too small to see. */
  page.drawBodies = function (view) {
    const { ctx, look, moment } = view;
    const dimmed = (k) => view.showsBelief && k !== view.selected;
    ctx.globalAlpha = view.showsBelief ? DIMMED : 1;
    drawTarget(view);
    keepLabelsOff(view);
    moment.robots.forEach((_, k) => {
      ctx.globalAlpha = dimmed(k) ? DIMMED : 1;
      drawRobot(view, k);
    });
    ctx.font = look.font(moment.robots.length > 16 ? 11 : 13, 600);
    const ghosts = new Set(view.belief ? view.belief.n.map(([k]) => k) : []);
    moment.robots.forEach((_, k) => {
      if (ghosts.has(k)) return;
      const { lost, sil } = moment.frame;
      const named = moment.robots.length <= NAMED_ROBOTS_MAX || lost[k] || sil[k];
      ctx.globalAlpha = dimmed(k) ? DIMMED : 1;
      if (named || k === view.selected) drawName(view, k);
    });
    ctx.globalAlpha = 1;
  };

  /* The robot whose body is nearest to a point of the canvas, if it is near; null otherwise. */
  page.robotAt = function (view, x, y) {
    const reach = bodyPx(view, view.model.stage.radius_m) + 8;
    let [best, nearest] = [null, reach];
    view.moment.robots.forEach(([px, py], k) => {
      const off = Math.hypot(view.camera.x(px) - x, view.camera.y(py) - y);
      if (off <= nearest) [best, nearest] = [k, off];
    });
    return best;
  };
})((window.encirclePage = window.encirclePage || {}));
