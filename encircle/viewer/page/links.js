/* Packets on their way from robot to robot, coloured and shaped by their fate. */
"use strict";

(function (page) {
  const SIZE_PX = 4.2;
  const TAIL_ALPHA = 0.3;
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
      page.drawShape(ctx, shape, half, half, size, look.colour(role), 2);
      sprites.images.set(fate, { image, half });
    }
    return sprites.images.get(fate);
  }

  /* Where a packet is: from the sender at the tick of sending to the receiver as it moves. */
  function flight(view, sentTick, packet, due, style) {
    const { model, moment } = view;
    const from = model.frames[sentTick].r[packet[0]];
    const to = moment.robots[packet[1]];
    const passed = moment.time - sentTick;
    const share = due > 0 ? passed / (due - sentTick) : Math.min(1, LOSS_HASTE * passed);
    return [from, page.between(from, to, Math.min(1, share) * style.reach)];
  }

  /* Draws all packets that are on their way; returns how many. */
  page.drawLinks = function (view) {
    const { ctx, camera, look, model, moment, layers, selected } = view;
    const fates = model.fates;
    const styles = fates.map(page.fateStyle);
    const flights = fates.map(() => []);
    let count = 0;
    model.eachInFlight(moment.time, (sentTick, packet, due, fate) => {
      if (!layers.fates[fates[fate]]) return;
      if (layers.own && selected !== null && packet[0] !== selected && packet[1] !== selected) return;
      flights[fate].push(flight(view, sentTick, packet, due, styles[fate]));
      count += 1;
    });
    ctx.lineWidth = 1.2;
    flights.forEach((some, fate) => {
      if (!some.length) return;
      ctx.globalAlpha = TAIL_ALPHA;
      ctx.strokeStyle = look.colour(styles[fate].role);
      ctx.beginPath();
      for (const [from, at] of some) {
        ctx.moveTo(camera.x(from[0]), camera.y(from[1]));
        ctx.lineTo(camera.x(at[0]), camera.y(at[1]));
      }
      ctx.stroke();
      ctx.globalAlpha = 1;
      const { image, half } = sprite(look, fates[fate], SIZE_PX * look.scale);
      for (const [, at] of some) {
        const [x, y] = [camera.x(at[0]) - half, camera.y(at[1]) - half];
        ctx.drawImage(image, x, y, 2 * half, 2 * half);
      }
    });
    return count;
  };
})((window.encirclePage = window.encirclePage || {}));
