/* The page as a whole: what there is is wired together here, and drawn.

window.encircle is the page for scripts and tests:

  state()        what is shown: ready (the run has been drawn), run, title, live, connection, notice,
                 tick, time, last_tick, playing, following, speed, selected (a name or null), theme,
                 large_type, layers, view, captured, outcome, fates (counts of packets sent before
                 the tick), events (how many), belief (errors in m of the picked robot's picture, or
                 null), packets_drawn; what was asked for last is drawn at the next frame
  seek(tick)     goes to a tick, or the nearest that there is
  play(), pause()
  select(name)   shows the world as this robot believes it; null: the truth
  stats()        frames drawn since the last reset_stats(): frames_per_s, quantiles of the times
                 between frames and of drawing, in ms, and the most packets that were drawn at once
  reset_stats()

An address may end in #tick=T&robot=NAME&theme=dark&type=large&view=close&play=1&speed=S. */
"use strict";

(function (page) {
  const BELIEF_KEY =
    "Dashed: peers, age of what it knows. Shaded: 95 % of the estimate. Dots: prediction. Faded: the truth.";
  const PAUSE_MS = 250; // A longer time between two frames is no pace of drawing.
  const model = new page.Model();
  const player = new page.Player(model);
  const look = new page.Look();
  const stats = new page.Stats();
  const header = new page.Header();
  const layers = { trails: true, rings: true, goals: true, packets: true, own: true, fates: {} };
  const view = {
    model, look, layers, camera: new page.Camera(), moment: null, selected: null, belief: null,
    showsBelief: false, labels: new page.Labels(),
  };
  const canvas = page.byId("arena");
  const source = page.sourceOf(() => model.position());
  let connection = "connecting";
  let packetsDrawn = 0;
  let [begunVersion, drawnVersion] = [-1, -1];
  let [scheduled, before, shownKey] = [false, null, ""];

  const acts = {
    redraw,
    toggle: () => player.toggle(),
    play: () => player.play(),
    pause: () => player.pause(),
    seek: (tick) => player.seek(tick),
    step: (ticks) => player.step(ticks),
    setSpeed: (speed) => player.setSpeed(speed),
    changeSpeed: (by) => player.changeSpeed(by),
    follow: () => {
      if (model.status.state === "running") player.follow();
    },
    event(forward) {
      const tick = page.eventTick(model, player.tick, forward);
      if (tick !== null) player.seek(tick);
    },
    select(k) {
      if (k !== null && !(model.stage && k < model.stage.robots.length)) return;
      view.selected = k;
      refresh();
    },
    selectBy(by) {
      const n = model.stage ? model.stage.robots.length : 0;
      if (!n) return;
      const from = view.selected === null ? (by > 0 ? -1 : n) : view.selected;
      acts.select(((from + by) % n + n) % n);
    },
    switchLayer(layer) {
      layers[layer] = !layers[layer];
      refresh();
    },
    switchFate(fate) {
      layers.fates[fate] = !layers.fates[fate];
      refresh();
    },
    switchView() {
      view.camera.setMode(view.camera.mode === "whole" ? "close" : "whole");
      refresh();
    },
    switchTheme: () => look.setTheme(look.theme === "dark" ? "light" : "dark"),
    switchType: () => look.setLarge(!look.large),
    help() {
      const help = page.byId("help");
      if (help.open) help.close();
      else help.showModal();
    },
  };

  const charts = new page.Charts(page.byId("charts"), look, acts.seek, refresh);
  const matrix = new page.Matrix(page.byId("matrix"), page.byId("matrix-key"), page.byId("matrix-unit"), look, acts.select);
  const events = new page.Events(page.byId("events"), page.byId("marks"), page.byId("contacts"), look, acts.seek);
  const legend = new page.Legend(page.byId("fates"), look, layers, acts.switchFate);

  /* Draws at the next chance. */
  function redraw() {
    if (scheduled) return;
    scheduled = true;
    requestAnimationFrame(drawFrame);
  }

  /* Draws, and shows anew what changes by tick or by hand alone. */
  function refresh() {
    shownKey = "";
    redraw();
  }

  function drawFrame(now) {
    scheduled = false;
    const interval = before === null ? null : now - before;
    const s = Math.min(PAUSE_MS, interval || 0) / 1000;
    player.advance(s);
    const start = performance.now();
    const moving = drawArena(s);
    drawPanels();
    if (player.moving) stats.record(interval, performance.now() - start, packetsDrawn);
    before = player.moving || moving ? now : null;
    if (player.moving || moving) redraw();
  }

  function drawArena(s) {
    view.moment = page.momentAt(model, player.time);
    Object.assign(view, page.fittedCanvas(canvas));
    view.ctx.fillStyle = look.colour("background");
    view.ctx.fillRect(0, 0, view.width, view.height);
    packetsDrawn = 0;
    if (!view.moment) return false;
    // Where nothing moves, the view is where it belongs.
    const stretchS = player.playing || player.following ? s : Infinity;
    const moving = view.camera.update(model, view.moment, view.width, view.height, stretchS);
    const belief = page.beliefOf(view.moment.frame, view.selected);
    Object.assign(view, { belief, showsBelief: Boolean(belief) });
    view.labels.begin();
    page.drawGrid(view);
    page.drawObstacles(view);
    if (layers.trails) page.drawTrails(view);
    if (layers.rings) page.drawRings(view);
    if (layers.goals) page.drawGoals(view);
    if (layers.packets) packetsDrawn = page.drawLinks(view);
    page.drawScaleBar(view);
    page.drawBodies(view);
    if (belief) page.drawBelief(view, belief);
    return moving;
  }

  /* All beside the arena; it changes with ticks, not between them. */
  function drawPanels() {
    const notice = page.notice(model, connection, view.selected);
    header.update(model, player, notice);
    const { tick } = player;
    const key = [tick, model.frames.length, model.version, connection].join();
    if (key === shownKey) return;
    shownKey = key;
    page.showControls(model, player, view);
    if (!view.moment) return;
    legend.update(model, tick);
    matrix.draw(model.stage, view.moment.frame, view.selected);
    events.update(model, tick);
    charts.update(model, tick, view.moment);
    showBeliefWords();
    drawnVersion = model.version;
    if (!player.moving) canvas.setAttribute("aria-label", page.arenaWords(model.stage, view.moment.frame));
  }

  function showBeliefWords() {
    const element = page.byId("belief");
    const errors = page.beliefErrors(model.stage, view.moment.frame, view.selected);
    element.hidden = view.selected === null;
    if (view.selected === null) return;
    const name = model.stage.robots[view.selected];
    page.setText(element, errors ? beliefWords(name, errors) : noBeliefWords(name));
  }

  function noBeliefWords(name) {
    const ended = model.status.state === "ended" && player.tick === model.lastTick;
    if (ended) return `${name} decides no more: the run is over.`;
    const lost = view.moment.frame.lost[view.selected];
    if (lost) return `${name} is lost: it believes nothing.`;
    const doubt = model.events.findLast(
      ({ kind, tick, robots }) => kind === "unsure" && tick <= player.tick && robots.includes(name),
    );
    const words = doubt ? doubt.text : `what ${name} believes at this tick is not known`;
    return `${words[0].toUpperCase()}${words.slice(1)}.`;
  }

  function beliefWords(name, { peers, target }) {
    const worst = peers.reduce((most, peer) => (peer[1] > most[1] ? peer : most), ["", -1]);
    const parts = [];
    parts.push(peers.length ? `off by ${worst[1].toFixed(2)} m for ${worst[0]} at most` : "no peer is known");
    parts.push(target === null ? "no estimate of the target" : `by ${target.toFixed(2)} m for the target`);
    return `As ${name} believes it: ${parts.join(", ")}. ${BELIEF_KEY}`;
  }

  function take(message) {
    const { version, status } = model;
    const wasRunning = status.state === "running";
    model.take(message);
    if (model.version !== version) begin();
    player.time = Math.max(player.time, model.firstTick);
    const untouched = player.time === model.firstTick && !player.playing;
    if (!wasRunning && status.state === "running" && untouched) player.follow();
    for (const fate of model.fates) if (!(fate in layers.fates)) layers.fates[fate] = true;
    if (model.hasFrames && begunVersion !== model.version) {
      begunVersion = model.version;
      view.camera.begin(model, canvas.clientWidth, canvas.clientHeight, source.live);
      matrix.drawKey(model.stage);
      applyAddress();
    }
    if (model.status.control && page.mountControl && !page.byId("control").childElementCount) {
      page.byId("control").hidden = false;
      page.mountControl(page.byId("control"), source, model, view);
    }
    refresh();
  }

  /* Another run: from its start, or along with it if it is live. */
  function begin() {
    Object.assign(player, { time: 0, playing: false, following: model.status.state === "running" });
    view.selected = null;
    view.camera = new page.Camera();
  }

  /* What the address asks for behind its "#". */
  function applyAddress() {
    const asked = new URLSearchParams(location.hash.slice(1));
    if (asked.has("tick")) player.seek(Number(asked.get("tick")) || 0);
    if (asked.has("robot")) selectNamed(asked.get("robot"));
    if (asked.has("theme")) look.setTheme(asked.get("theme") === "dark" ? "dark" : "light");
    if (asked.has("type")) look.setLarge(asked.get("type") === "large");
    if (asked.has("view")) view.camera.setMode(asked.get("view") === "close" ? "close" : "whole");
    if (page.SPEEDS.includes(Number(asked.get("speed")))) player.setSpeed(Number(asked.get("speed")));
    if (asked.get("play") === "1") player.play();
  }

  function selectNamed(name) {
    const k = name === null ? -1 : model.stage.robots.indexOf(name);
    acts.select(k < 0 ? null : k);
  }

  function state() {
    const { stage } = model;
    const notice = page.notice(model, connection, view.selected);
    const fates = model.fates;
    const counts = stage ? [...model.fateCounts(player.tick)] : [];
    const frame = model.frameAt(player.tick);
    return {
      ready: drawnVersion === model.version, run: stage && stage.run, title: stage && stage.title,
      live: source.live, connection, notice: notice && notice.text,
      tick: player.tick, time: player.time, last_tick: model.lastTick,
      playing: player.playing, following: player.following, speed: player.speed,
      selected: view.selected === null ? null : stage.robots[view.selected],
      theme: look.theme, large_type: look.large, view: view.camera.mode,
      layers: { ...layers, fates: { ...layers.fates } },
      captured: Boolean(frame && frame.cap), outcome: stage && frame ? page.outcome(model, player.tick).text : null,
      fates: Object.fromEntries(fates.map((fate, k) => [fate, counts[k] || 0])),
      events: model.events.length,
      belief: stage && frame ? page.beliefErrors(stage, frame, view.selected) : null,
      packets_drawn: packetsDrawn,
    };
  }

  window.encircle = Object.freeze({
    state,
    seek: acts.seek,
    play: acts.play,
    pause: acts.pause,
    select: selectNamed,
    stats: () => stats.summary(),
    reset_stats: () => stats.reset(),
  });

  player.changed = refresh;
  look.listeners.push(() => {
    if (model.stage) matrix.drawKey(model.stage);
    charts.restyle();
    refresh();
  });
  window.addEventListener("resize", () => setTimeout(refresh, 0));
  // Before the browser shows it in its new size, which would stretch the picture of before.
  new ResizeObserver(() => drawArena(0)).observe(canvas);
  window.addEventListener("hashchange", () => {
    if (model.hasFrames) applyAddress();
    refresh();
  });
  page.wireControls(acts);
  page.wirePointer(canvas, view, acts);
  page.listenToKeys(acts);
  source
    .start(take, (now) => {
      connection = now;
      refresh();
    })
    .catch((error) => {
      connection = "failed";
      console.error(error);
      refresh();
    });
  redraw();
})((window.encirclePage = window.encirclePage || {}));
