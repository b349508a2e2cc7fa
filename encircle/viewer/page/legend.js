/* The legend is the switchboard: each fate with its shape, its count so far, and a switch. */
"use strict";

(function (page) {
  const WORDS = {
    arrived: "arrived at the next tick",
    late: "late",
    loss: "lost by chance",
    "burst-loss": "lost in a burst",
    "trace-loss": "lost in the trace",
    "distance-loss": "lost over distance",
    "weak-signal": "signal too weak",
    "out-of-range": "out of range",
    "sender-silent": "sender silent",
    "receiver-silent": "receiver silent",
    outage: "outage",
    partition: "team cut in two",
    "queue-full": "queue full",
    contention: "contention",
  };

  /* What a fate is called for people. */
  page.fateWords = (fate) => WORDS[fate] || fate;

  class Legend {
    constructor(element, look, layers, onSwitch) {
      Object.assign(this, { element, look, layers, onSwitch, key: "", counts: new Map() });
    }

    /* Shows the fates that the run has, with how many packets met each before a tick. */
    update(model, tick) {
      const fates = model.fates;
      const total = model.fateCounts(model.frames.length);
      const listed = fates.filter((fate, k) => k < 2 || total[k] > 0);
      const key = [model.version, listed.join(), this.look.theme, this.look.scale].join();
      if (key !== this.key) {
        this.key = key;
        this.build(listed);
      }
      const counts = model.fateCounts(tick);
      for (const [fate, { count, chip }] of this.counts) {
        page.setText(count, String(counts[fates.indexOf(fate)]));
        chip.setAttribute("aria-pressed", String(this.layers.fates[fate]));
      }
    }

    build(listed) {
      this.counts.clear();
      this.element.replaceChildren(
        ...listed.map((fate) => {
          const { role, shape } = page.fateStyle(fate);
          const count = page.element("span", { class: "count" });
          const chip = page.element(
            "button",
            { type: "button", class: "chip", "data-fate": fate, title: "Show or hide these packets" },
            page.shapeIcon(shape, this.look.colour(role), 15 * this.look.scale, this.look.colour("ink")),
            page.fateWords(fate), " ", count,
          );
          chip.addEventListener("click", () => this.onSwitch(fate));
          this.counts.set(fate, { count, chip });
          return chip;
        }),
      );
    }
  }

  page.Legend = Legend;
})((window.encirclePage = window.encirclePage || {}));
