/* Packets on their way from robot to robot, coloured and shaped by their fate. */
"use strict";

(function (page) {
  const SIZE_PX = 4.2;
  const LANE_PX = 3.5;
  const TAIL_ALPHA = 0.4;
  const TAILS = 60; // Of more, each is fainter.
  const TAILS_MAX = 800; // Of more, none is seen.
  const CROWDED = 250;
  const CROWDED_PX = 3;
  const LOSS_HASTE = 1.8; // A lost packet is at its end before its tick is over, to be seen there.

  let sprites = { key: "", images: new Map() };

  /* A picture of a fate's shape, drawn once for each theme, size and screen. */
  function sprite(look, fate, size) {
    const ratio = window.devicePixelRatio || 1;
    const key = `${look.theme} ${size} ${ratio}`;
    if (sprites.key !== key) sprites = { key, images: new Map() };
    if (!sprites.images.has(fate)) {
      const image = document.createElement("canvas");
      const { role, shape } = page.fateStyle(fate);
      const half = Math.ceil(1.6 * size);
      image.width = image.height = Math.round(2 * half * ratio);
      const ctx = image.getContext("2d");
      ctx.scale(ratio, ratio);
      page.drawShape(ctx, shape, half, half, size, look.colour(role), { lineWidth: 2, outline: look.colour("ink") });
      sprites.images.set(fate, { image, half });
    }
    return sprites.images.get(fate);
  }

  /* Where a packet is: from the sender at the tick of sending to the receiver as it moves, from body
     to body, so that an arrived one is seen beside its receiver, and on the right-hand side of the way,
     so that the two directions of a pair are apart. Places on the canvas. */
  function flight(view, sentTick, packet, due, style, inset) {
    const { camera, model, moment } = view;
    const start = model.frames[sentTick].r[packet[0]];
    const end = moment.robots[packet[1]];
    const [x, y] = [camera.x(start[0]), camera.y(start[1])];
    const [dx, dy] = [camera.x(end[0]) - x, camera.y(end[1]) - y];
    const length = Math.max(1, Math.hypot(dx, dy));
    const cut = Math.min(0.4, inset / length);
    const side = LANE_PX / length;
    const at = (part) => [x + part * dx - side * dy, y + part * dy + side * dx];
    const [from, to] = [at(cut), at(1 - cut)];
    const passed = moment.time - sentTick;
    const share = due > 0 ? passed / (due - sentTick) : Math.min(1, LOSS_HASTE * passed);
    return [from, page.between(from, to, Math.min(1, share) * style.reach)];
  }

  function drawTails(ctx, flights, colour, count) {
    ctx.globalAlpha = Math.min(TAIL_ALPHA, (TAIL_ALPHA * TAILS) / count);
    ctx.strokeStyle = colour;
    ctx.beginPath();
    for (const [from, at] of flights) {
      ctx.moveTo(from[0], from[1]);
      ctx.lineTo(at[0], at[1]);
    }
    ctx.stroke();
    ctx.globalAlpha = 1;
  }

  /* Draws all packets that are on their way; returns how many. */
  page.drawLinks = function (view) {
    const { ctx, look, model, moment, layers, selected } = view;
    const inset = page.bodyPx(view, model.stage.radius_m) + SIZE_PX * look.scale;
    const fates = model.fates;
    const styles = fates.map(page.fateStyle);
    const flights = fates.map(() => []);
    let count = 0;
    model.eachInFlight(moment.time, (sentTick, packet, due, fate) => {
      if (!layers.fates[fates[fate]]) return;
      if (layers.own && selected !== null && packet[0] !== selected && packet[1] !== selected) return;
      flights[fate].push(flight(view, sentTick, packet, due, styles[fate], inset));
      count += 1;
    });
    ctx.lineWidth = 1.2;
    flights.forEach((some, fate) => {
      if (!some.length) return;
      if (count <= TAILS_MAX) drawTails(ctx, some, look.colour(styles[fate].role), count);
      const size = (count > CROWDED ? CROWDED_PX : SIZE_PX) * look.scale;
      const { image, half } = sprite(look, fates[fate], size);
      for (const [, at] of some) ctx.drawImage(image, at[0] - half, at[1] - half, 2 * half, 2 * half);
    });
    return count;
  };
})((window.encirclePage = window.encirclePage || {}));
