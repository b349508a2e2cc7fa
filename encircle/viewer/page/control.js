/* The radio in the reader's hand: what this page may change in a run that it watches.

page.mountControl(element, source, model, view) is called once, when a status says that this page
may change the radio. It fills the element. Of the messages of a source it takes those with a key
"control", an object with one or more of these keys:

  radio    what is in force: {own: {rate, delay_s, range_m}, now: {rate, delay_s, range_m}, tick_s};
           a number, or null: in own if the scenario's radio has no such number, in now if the
           scenario's own is in force
  taken    {given, event}: an event that the run has taken at a tick, as its scenario would have it
  refused  why an event was not taken, in one line

It sends {"radio": true} to ask what is in force, and {"intervene": EVENT}. */
"use strict";

(function (page) {
  const SEND_MS = 300; // A slider that is moved sends no more often.
  const SLIDERS = [
    { kind: "loss", key: "rate", title: "Loss", unit: "%", perUnit: 0.01, max: 100, step: 1 },
    { kind: "delay", key: "delay_s", title: "Delay", unit: "s", perUnit: 1, max: 2, step: 0.05 },
    { kind: "range", key: "range_m", title: "Range", unit: "m", perUnit: 1, min: 1, max: 40, step: 0.5 },
  ];
  const SILENCE_TICKS = 30;
  const OVER = "The run is over: nothing can be changed.";

  const { element, byId, setText } = page;

  /* Whether another loss, delay or range is in force from a frame's tick on. */
  const changesRadio = ({ ev }) => ev.some(([kind]) => SLIDERS.some((about) => about.kind === kind));

  function button(text, title, act) {
    const made = element("button", { type: "button", title }, text);
    made.addEventListener("click", act);
    return made;
  }

  const shown = (value) => String(Number(value.toPrecision(4)));
  const worded = (kind, value, unit) =>
    value === undefined ? `${kind} as the scenario has it` : `${kind} ${shown(value)}\u00a0${unit}`;

  class Control {
    constructor(root, source, model, view) {
      Object.assign(this, { root, source, model, view, radio: null, tickS: 0.1, sides: new Set() });
      this.sliders = SLIDERS.map((about) => new Slider(about, (event) => this.give(event)));
      this.said = element("p", { id: "control-said", role: "status" });
      this.when = element("small", {}, "from the next tick on");
      this.over = element("p", { id: "control-over", role: "status", hidden: true }, OVER);
      this.robots = element("span", { class: "sides", role: "group", "aria-label": "One side of the cut" });
      this.silenced = element("select", { id: "control-silence", "aria-label": "Robot" });
      this.ticks = element("input", {
        id: "control-ticks", type: "number", min: 1, max: 10000, value: SILENCE_TICKS, "aria-label": "Ticks",
      });
      this.mover = button("Move target", "Then press in the arena (Esc: not)", () => this.arm(!this.armed));
      this.mover.id = "control-move";
      this.fill();
      this.listenToArena();
      model.listeners.push((message) => this.take(message));
      this.showRobots();
      this.showOver();
      source.send({ radio: true });
    }

    fill() {
      const cut = button("Cut", "Nothing passes between the two sides", () => this.cut());
      const heal = button("Heal", "Cuts and silences end", () => this.give({ kind: "heal" }));
      const silence = button("Silence", "This robot's radio is off for so many ticks", () => this.silence());
      [cut.id, heal.id, silence.id] = ["control-cut", "control-heal", "control-hush"];
      this.all = element(
        "fieldset", {},
        ...this.sliders.map((slider) => slider.row),
        element("div", { class: "row" }, element("span", { class: "what" }, "Cut"), cut, heal, "◧ from ◨"),
        this.robots,
        element(
          "div", { class: "row" }, element("span", { class: "what" }, "Silence"), this.silenced,
          "for", this.ticks, "ticks", silence,
        ),
        element("div", { class: "row" }, element("span", { class: "what" }, "Target"), this.mover),
      );
      this.root.append(
        element("h2", {}, "Radio in your hand ", this.when), this.over, this.all, this.said,
      );
    }

    take(message) {
      if (message.stage) this.showRobots();
      if (message.status) {
        this.showOver();
        // After a new connection something may have been missed.
        this.source.send({ radio: true });
      } else if ((message.frames || []).some(changesRadio)) {
        this.source.send({ radio: true });
      }
      const { control } = message;
      if (!control) return;
      if (control.radio) this.showRadio(control.radio);
      if (control.taken) this.showTaken(control.taken);
      if (control.refused) {
        for (const slider of this.sliders) slider.show(slider.own, slider.now, this.tickS);
        this.say(control.refused, "bad");
      }
    }

    /* Of a run that is over nothing can be changed: nothing can be pressed, and why is told. */
    showOver() {
      const over = this.model.status.state === "ended";
      this.over.hidden = !over;
      this.when.hidden = over;
      this.all.disabled = over;
      if (!over) return;
      this.arm(false);
      for (const slider of this.sliders) slider.letGo();
    }

    showRadio(radio) {
      this.tickS = radio.tick_s;
      for (const slider of this.sliders) {
        slider.show(radio.own[slider.about.key], radio.now[slider.about.key], radio.tick_s);
      }
    }

    showTaken({ given, event }) {
      const slider = this.sliders.find(({ about }) => about.kind === event.kind);
      const value = slider ? event[slider.about.key] : undefined;
      if (slider) slider.show(slider.own, value === undefined ? null : value, this.tickS);
      const when = event.kind === "move-target" ? `at tick ${event.tick}` : `in force from tick ${event.tick} on`;
      this.say(`Taken at tick ${given}; ${when}: ${words(event)}`, "good");
    }

    say(text, kind) {
      this.said.dataset.kind = kind;
      setText(this.said, text);
    }

    /* Sends an event; whether there was a connection, and a run that goes on. */
    give(event) {
      if (this.all.disabled) return false;
      const sent = this.source.send({ intervene: event });
      if (!sent) this.say("No connection: nothing was changed.", "bad");
      return sent;
    }

    showRobots() {
      const names = this.model.stage ? this.model.stage.robots : [];
      const key = names.join("\n");
      if (this.robots.dataset.key === key) return;
      this.robots.dataset.key = key;
      this.sides = new Set(names.slice(0, Math.floor(names.length / 2)));
      this.robots.replaceChildren(...names.map((name) => this.sideSwitch(name)));
      this.silenced.replaceChildren(...names.map((name) => element("option", {}, name)));
    }

    /* A switch that says on which side of the cut a robot is. */
    sideSwitch(name) {
      const made = button("", `${name}: this side or that`, () => {
        if (!this.sides.delete(name)) this.sides.add(name);
        show();
      });
      const show = () => {
        const first = this.sides.has(name);
        made.setAttribute("aria-pressed", String(first));
        setText(made, `${name}${first ? "◧" : "◨"}`);
      };
      show();
      return made;
    }

    cut() {
      const names = this.model.stage ? this.model.stage.robots : [];
      const groups = [true, false].map((side) => names.filter((name) => this.sides.has(name) === side));
      if (groups.some((group) => !group.length)) {
        this.say("Both sides of a cut need a robot.", "bad");
      } else {
        this.give({ kind: "partition", groups });
      }
    }

    silence() {
      const ticks = Number(this.ticks.value);
      this.give({ kind: "silence", robot: this.silenced.value, ticks });
    }

    arm(armed) {
      this.armed = armed;
      this.mover.setAttribute("aria-pressed", String(armed));
      byId("arena").classList.toggle("aims", armed);
      setText(this.mover, armed ? "Press in the arena" : "Move target");
    }

    /* While armed, the next press in the arena is for the target, and for nothing else. */
    listenToArena() {
      const arena = byId("arena");
      arena.parentElement.addEventListener("pointerdown", (event) => {
        if (!this.armed || event.target !== arena) return;
        event.stopPropagation();
        const [x, y] = this.view.camera.place(event.offsetX, event.offsetY);
        this.arm(false);
        this.give({ kind: "move-target", position: [x, y].map((m) => Math.round(100 * m) / 100) });
      }, true);
      window.addEventListener("keydown", (event) => {
        if (event.key === "Escape" && this.armed) this.arm(false);
      });
    }
  }

  /* One number of the radio: a slider, its value in words, and back to the scenario's own. */
  class Slider {
    constructor(about, give) {
      Object.assign(this, { about, give, own: null, now: null, tickS: 0.1, timer: null, wanted: null, sentMs: -SEND_MS });
      const id = `control-${about.kind}`;
      this.input = element("input", {
        id, type: "range", min: about.min || 0, max: about.max, step: about.step, "aria-label": about.title,
      });
      this.output = element("output", { for: id });
      this.back = button("↺", "As the scenario has it", () => {
        this.stopTimer();
        this.give({ kind: about.kind });
      });
      this.back.id = `${id}-own`;
      this.back.setAttribute("aria-label", `${about.title} as the scenario has it`);
      this.row = element(
        "div", { class: "row slider" }, element("label", { class: "what", for: id }, about.title),
        this.input, this.output, this.back,
      );
      this.input.addEventListener("input", () => this.moved());
      this.input.addEventListener("change", () => this.send());
      this.show(null, null, this.tickS);
    }

    get value() {
      return Number((Number(this.input.value) * this.about.perUnit).toPrecision(6));
    }

    /* What is in force: own is the scenario's number, if it has one; now null: its own. */
    show(own, now, tickS) {
      Object.assign(this, { own, now, tickS, wanted: null });
      const value = now === null ? own : now;
      const held = this.timer !== null;
      const unknown = this.about.kind === "range" ? this.about.max : this.input.min;
      if (!held) this.input.value = String(value === null ? unknown : value / this.about.perUnit);
      if (!held) this.tell(value, now === null);
      this.back.disabled = now === null;
    }

    tell(value, isOwn) {
      const { about } = this;
      let text = "as the scenario";
      if (value !== null) {
        text = `${shown(value / about.perUnit)} ${about.unit}`;
        if (about.kind === "delay") {
          const ticks = Math.max(1, Math.ceil(value / this.tickS - 1e-9));
          text += ` (${page.counted(ticks, "tick")})`;
        }
        if (isOwn) text += about.kind === "delay" ? "" : " (scenario)";
      }
      setText(this.output, text);
      this.input.setAttribute("aria-valuetext", text);
    }

    /* Moved by hand: told at once, sent now and then, and at last. */
    moved() {
      this.tell(this.value, false);
      if (this.timer !== null) return;
      const wait = Math.max(0, this.sentMs + SEND_MS - performance.now());
      this.timer = setTimeout(() => this.send(), wait);
    }

    stopTimer() {
      clearTimeout(this.timer);
      this.timer = null;
    }

    /* Sends nothing of what was moved, and shows what is in force. */
    letGo() {
      this.stopTimer();
      this.show(this.own, this.now, this.tickS);
    }

    send() {
      this.stopTimer();
      // What was sent is not sent again before it is known what became of it.
      if (this.value === (this.wanted === null ? this.now : this.wanted)) return;
      this.wanted = this.value;
      this.sentMs = performance.now();
      this.give({ kind: this.about.kind, [this.about.key]: this.value });
    }
  }

  /* An event in a few words; what follows from it stands in the list of events. */
  function words(event) {
    switch (event.kind) {
      case "loss": return worded("loss", event.rate === undefined ? undefined : 100 * event.rate, "%");
      case "delay": return worded("delay", event.delay_s, "s");
      case "range": return worded("range", event.range_m, "m");
      case "partition": return `cut ${event.groups.map((group) => group.join(", ")).join(" | ")}`;
      case "silence": return `${event.robot} silent` + (event.ticks ? ` for ${page.counted(event.ticks, "tick")}` : "");
      case "move-target": return `target to (${event.position.map(shown).join(", ")}) m`;
      case "heal": return "cuts and silences end";
      default: return event.kind;
    }
  }

  page.mountControl = function (root, source, model, view) {
    return new Control(root, source, model, view);
  };
})((window.encirclePage = window.encirclePage || {}));
