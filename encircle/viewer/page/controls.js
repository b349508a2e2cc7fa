/* Buttons, sliders and the pointer: whatever is done by hand goes to the page's acts. */
"use strict";

(function (page) {
  const ZOOM_STEP = 1.0015;
  const VIEWS = { whole: "whole arena", close: "close by", free: "by hand" };

  /* Wires the transport bar, the tool bar and the panels to the acts. */
  page.wireControls = function (acts) {
    const on = (id, act) => page.byId(id).addEventListener("click", act);
    on("play", () => acts.toggle());
    on("back", () => acts.step(-1));
    on("on", () => acts.step(1));
    on("follow", () => acts.follow());
    on("theme", () => acts.switchTheme());
    on("type", () => acts.switchType());
    on("help-button", () => acts.help());
    on("help-close", () => page.byId("help").close());
    on("view", () => acts.switchView());
    for (const layer of ["trails", "rings", "goals", "packets", "own"]) {
      on(`layer-${layer}`, () => acts.switchLayer(layer));
    }
    page.byId("slider").addEventListener("input", (event) => acts.seek(Number(event.target.value)));
    const speed = page.byId("speed");
    speed.append(...page.SPEEDS.map((s) => page.element("option", { value: s }, `${s}×`)));
    speed.addEventListener("change", () => acts.setSpeed(Number(speed.value)));
    const robot = page.byId("robot");
    robot.addEventListener("change", () => acts.select(robot.value === "" ? null : Number(robot.value)));
    page.byId("keys").append(...page.keyRows());
  };

  /* Wheel zooms, a drag moves the view, a click picks a robot. */
  page.wirePointer = function (canvas, view, acts) {
    let [down, moved] = [null, false];
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      view.camera.zoom(ZOOM_STEP ** -event.deltaY, event.offsetX, event.offsetY);
      acts.redraw();
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      [down, moved] = [[event.offsetX, event.offsetY], false];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!down || !event.buttons) return;
      const [dx, dy] = [event.offsetX - down[0], event.offsetY - down[1]];
      if (!moved && Math.hypot(dx, dy) < 4) return;
      moved = true;
      down = [event.offsetX, event.offsetY];
      view.camera.pan(dx, dy);
      acts.redraw();
    });
    canvas.addEventListener("pointerup", (event) => {
      if (down && !moved && view.moment) {
        const picked = page.robotAt(view, event.offsetX, event.offsetY);
        acts.select(picked === view.selected ? null : picked);
      }
      down = null;
    });
  };

  function pressed(id, state) {
    page.byId(id).setAttribute("aria-pressed", String(Boolean(state)));
  }

  function showRobots(model, selected) {
    const robot = page.byId("robot");
    const names = model.stage ? model.stage.robots : [];
    const key = names.join("\n");
    if (robot.dataset.key !== key) {
      robot.dataset.key = key;
      const options = names.map((name, k) => page.element("option", { value: k }, name));
      robot.replaceChildren(page.element("option", { value: "" }, "nobody (truth)"), ...options);
    }
    robot.value = selected === null ? "" : String(selected);
  }

  /* Shows the state of everything that is switched. */
  page.showControls = function (model, player, view) {
    const { layers, look, camera, selected } = view;
    const slider = page.byId("slider");
    const { tick } = player;
    slider.min = String(model.firstTick);
    slider.max = String(model.lastTick);
    slider.value = String(tick);
    const s = model.stage ? (tick * model.stage.tick_s).toFixed(1) : "0";
    slider.setAttribute("aria-valuetext", `tick ${tick} of ${model.lastTick}, ${s} s`);
    page.setText(page.byId("last"), `of ${model.lastTick}`);
    const runs = player.playing || player.following;
    page.byId("play").dataset.state = runs ? "playing" : "paused";
    page.byId("play").setAttribute("aria-label", runs ? "Pause" : "Play");
    page.byId("speed").value = String(player.speed);
    page.byId("follow").hidden = model.status.state !== "running";
    pressed("follow", player.following);
    for (const layer of ["trails", "rings", "goals", "packets", "own"]) {
      pressed(`layer-${layer}`, layers[layer]);
    }
    page.setText(page.byId("view"), `view: ${VIEWS[camera.mode]}`);
    pressed("theme", look.theme === "dark");
    pressed("type", look.large);
    showRobots(model, selected);
  };
})((window.encirclePage = window.encirclePage || {}));
