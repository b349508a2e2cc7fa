/* What happened and when: a list that goes to an event's tick, and marks on the time slider. */
"use strict";

(function (page) {
  const LISTED_MAX = 500;
  const LOOKS = {
    capture: ["diamond", "target"],
    end: ["square", "muted"],
    lost: ["x", "chance"],
    back: ["plus", "arrived"],
    silence: ["ring-x", "cut"],
    outage: ["box-x", "cut"],
    partition: ["bar", "cut"],
    moved: ["triangle", "late"],
    contact: ["disc", "signal"],
    intervention: ["wedge", "late"],
  };
  const UNMARKED = new Set(["contact"]);

  class Events {
    constructor(list, marks, look, onSeek) {
      Object.assign(this, { list, marks, look, onSeek, key: "" });
    }

    icon(kind, px) {
      const [shape, role] = LOOKS[kind] || ["disc", "muted"];
      return page.shapeIcon(shape, this.look.colour(role), px);
    }

    /* Makes list and marks anew if there are other events than before. */
    update(model, tick) {
      const { events, lastTick } = model;
      const key = [model.version, events.length, lastTick, this.look.theme, this.look.scale].join();
      if (key !== this.key) {
        this.key = key;
        this.list.replaceChildren(...this.entries(model));
        this.marks.replaceChildren(...this.markElements(model));
      }
      for (const entry of this.list.children) {
        entry.classList.toggle("past", Number(entry.dataset.tick) <= tick);
      }
    }

    entries(model) {
      if (!model.events.length) return [page.element("li", { class: "none" }, "nothing so far")];
      const shown = model.events.slice(-LISTED_MAX);
      return shown.map(({ tick, kind, text }) => {
        const s = (tick * model.stage.tick_s).toFixed(1);
        const button = page.element(
          "button", { type: "button", title: `Go to tick ${tick}` },
          this.icon(kind, 14 * this.look.scale),
          page.element("span", { class: "when" }, `${s} s`), page.element("span", {}, text),
        );
        button.addEventListener("click", () => this.onSeek(tick));
        return page.element("li", { "data-tick": tick }, button);
      });
    }

    markElements(model) {
      const last = Math.max(1, model.lastTick);
      return model.events
        .filter(({ kind }) => !UNMARKED.has(kind))
        .map(({ tick, kind, text }) => {
          const mark = page.element("span", { title: `tick ${tick}: ${text}` }, this.icon(kind, 13 * this.look.scale));
          mark.style.left = `${(100 * tick) / last}%`;
          return mark;
        });
    }
  }

  /* The tick of the next event after a tick, or the one before it; null if there is none. */
  page.eventTick = function (model, tick, forward) {
    const ticks = model.events.filter(({ kind }) => !UNMARKED.has(kind)).map((event) => event.tick);
    const found = forward ? ticks.filter((t) => t > tick)[0] : ticks.filter((t) => t < tick).pop();
    return found === undefined ? null : found;
  };

  page.Events = Events;
})((window.encirclePage = window.encirclePage || {}));
