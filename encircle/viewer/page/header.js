/* What is on top: the run, its time and outcome, and a notice when something is not as it should be. */
"use strict";

(function (page) {
  const KNOWN_CHANNEL_MAX = 6;
  const CHANGES = new Set(["loss", "delay", "range"]);

  /* The run's outcome in words, as far as it is known at a tick. */
  page.outcome = function (model, tick) {
    const { stage, status, lastTick } = model;
    const captured = model.captureTick;
    const at = (t) => `tick ${t} (${(t * stage.tick_s).toFixed(1)} s)`;
    if (captured !== null && tick >= captured) return { kind: "captured", text: `captured at ${at(captured)}` };
    if (captured !== null) return { kind: "open", text: `not yet captured; capture at ${at(captured)}` };
    if (status.state === "running") return { kind: "open", text: "hunting" };
    if (status.state === "waiting") return { kind: "open", text: "reading the recording" };
    if (!status.complete) return { kind: "cut", text: `cut off at ${at(lastTick)}` };
    const s = (lastTick * stage.tick_s).toFixed(1);
    return { kind: "missed", text: `no capture in ${page.counted(lastTick, "tick")} (${s} s)` };
  };

  /* The arena at a tick for who does not see it. */
  page.arenaWords = function (stage, frame) {
    const robots = stage.robots.map((name, k) => {
      const state = frame.lost[k] ? ", lost" : frame.sil[k] ? ", silent" : "";
      return `${name} ${frame.val.d[k].toFixed(1)} m from the target${state}`;
    });
    const s = (frame.t * stage.tick_s).toFixed(1);
    const captured = frame.cap ? " The target is captured." : "";
    return `The arena at tick ${frame.t}, ${s} s: ${robots.join("; ")}.${captured}`;
  };

  /* What the reader should know of the data itself: {kind, text}, or null if all is well. */
  page.notice = function (model, connection, selected) {
    if (connection === "failed") return { kind: "bad", text: "The data in this file cannot be read." };
    if (connection === "lost") {
      const goesOn = model.hasFrames ? " What came so far stays." : "";
      return { kind: "bad", text: `Connection lost: trying again.${goesOn}` };
    }
    if (!model.hasFrames) {
      return { kind: "wait", text: model.status.text || "No data yet: waiting for the run to begin." };
    }
    if (!model.status.complete) {
      const at = `it ends at tick ${model.lastTick}, before the end of its run`;
      return { kind: "warn", text: model.status.text || `This recording was cut off: ${at}.` };
    }
    if (selected !== null && !model.hasBeliefs) {
      return { kind: "warn", text: "This recording has no beliefs: only the truth can be shown." };
    }
    if (model.status.text) return { kind: "info", text: model.status.text };
    if (model.firstTick > 0) {
      return { kind: "info", text: `Looking on since tick ${model.firstTick}: what was before is not known here.` };
    }
    if (model.status.missed_ticks) {
      return { kind: "info", text: `This viewer was too slow for ${page.counted(model.status.missed_ticks, "tick")}.` };
    }
    return null;
  };

  class Header {
    constructor() {
      this.version = -1;
      this.channelKey = "";
    }

    updateRun(model) {
      const { stage } = model;
      this.version = model.version;
      page.setText(page.byId("title"), stage.title || stage.run);
      document.title = `${stage.title || stage.run} · Encircle`;
      page.setText(page.byId("seed"), `seed ${stage.seed}`);
      const policies = [...new Set(stage.policies)].join(", ");
      const team = page.counted(stage.robots.length, "robot");
      page.setText(page.byId("team"), `${team}, policy ${policies}; target: ${stage.behaviour}`);
      page.byId("channel").title = stage.channel.join("\n");
    }

    /* It changes with ticks and events, and is asked for with every frame. */
    updateChannel(model, tick) {
      const key = [model.version, tick, model.events.length].join();
      if (key === this.channelKey) return;
      this.channelKey = key;
      const { channel } = model.stage;
      const words = channel.slice(0, KNOWN_CHANNEL_MAX);
      const more = channel.length > words.length ? "; …" : "";
      const changed = model.events.some((event) => event.tick <= tick && CHANGES.has(event.kind));
      const which = changed ? "Radio at the start (since then changed, see the events)" : "Radio";
      page.setText(page.byId("channel"), `${which}: ${words.join("; ") || "every packet arrives at the next tick"}${more}`);
    }

    update(model, player, notice) {
      this.showNotice(notice);
      if (!model.stage) return;
      if (this.version !== model.version) this.updateRun(model);
      const { tick } = player;
      this.updateChannel(model, tick);
      page.setText(page.byId("tick"), `tick ${tick}`);
      page.setText(page.byId("seconds"), `${(player.time * model.stage.tick_s).toFixed(1)} s`);
      const outcome = page.outcome(model, tick);
      const element = page.byId("outcome");
      page.setText(element, outcome.text);
      element.dataset.kind = outcome.kind;
    }

    showNotice(notice) {
      const element = page.byId("notice");
      element.hidden = !notice;
      if (!notice) return;
      element.dataset.kind = notice.kind;
      page.setText(element, notice.text);
    }
  }

  page.Header = Header;
})((window.encirclePage = window.encirclePage || {}));
