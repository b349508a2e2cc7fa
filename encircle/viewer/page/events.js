/* What happened and when: a list that goes to an event's tick, and marks on the time slider. */
"use strict";

(function (page) {
  const LISTED_MAX = 500;
  const CONTACTS_SHOWN_MAX = 12; // Of more, the list shows none until it is asked to.
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
    loss: ["x", "chance"],
    delay: ["diamond", "late"],
    range: ["ring-x", "signal"],
    heal: ["plus", "arrived"],
    intervention: ["wedge", "late"],
    unsure: ["cross", "muted"],
    "cut-off": ["square", "chance"],
  };
  const UNMARKED = new Set(["contact"]);

  class Events {
    constructor(list, marks, contacts, look, onSeek) {
      Object.assign(this, { list, marks, contacts, look, onSeek, key: "", showsContacts: null });
      contacts.addEventListener("click", () => {
        this.showsContacts = contacts.getAttribute("aria-pressed") !== "true";
        this.key = "";
        this.update(this.model, this.tick);
      });
    }

    icon(kind, px) {
      const [shape, role] = LOOKS[kind] || ["disc", "muted"];
      return page.shapeIcon(shape, this.look.colour(role), px, this.look.colour("ink"));
    }

    /* Makes list and marks anew if there are other events than before. */
    update(model, tick) {
      Object.assign(this, { model, tick });
      const { events, lastTick } = model;
      const key = [model.version, events.length, this.look.theme, this.look.scale].join();
      if (key !== this.key) {
        this.key = key;
        this.list.replaceChildren(...this.entries(model));
        this.marks.replaceChildren(...this.markElements(model));
      }
      const { firstTick: first } = model;
      for (const mark of this.marks.children) {
        mark.style.left = `${(100 * (Number(mark.dataset.tick) - first)) / Math.max(1, lastTick - first)}%`;
      }
      let newest = null;
      for (const entry of this.list.children) {
        const past = Number(entry.dataset.tick) <= tick;
        entry.classList.toggle("past", past);
        if (past) newest = entry;
      }
      if (!this.list.matches(":hover, :focus-within")) this.scrollTo(newest);
    }

    /* Scrolls the list alone, so that an entry is in it; to the top without one. */
    scrollTo(entry) {
      const { list } = this;
      const top = entry ? entry.offsetTop - list.offsetTop : 0;
      if (top < list.scrollTop) list.scrollTop = top;
      const below = entry ? top + entry.offsetHeight - list.clientHeight : 0;
      if (below > list.scrollTop) list.scrollTop = below;
    }

    /* The events that the list shows: contacts if there are few, or as the switch says. */
    listed(events) {
      const contacts = events.filter(({ kind }) => kind === "contact").length;
      const shows = this.showsContacts === null ? contacts <= CONTACTS_SHOWN_MAX : this.showsContacts;
      this.contacts.hidden = !contacts;
      page.setText(this.contacts, `contacts ${contacts}`);
      this.contacts.setAttribute("aria-pressed", String(shows));
      return shows ? events : events.filter(({ kind }) => kind !== "contact");
    }

    entries(model) {
      const shown = this.listed(model.events).slice(-LISTED_MAX);
      if (!shown.length) return [page.element("li", { class: "none" }, "nothing so far")];
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
      return model.events
        .filter(({ kind }) => !UNMARKED.has(kind))
        .map(({ tick, kind, text }) => {
          const title = `tick ${tick}: ${text}`;
          return page.element("span", { title, "data-tick": tick }, this.icon(kind, 13 * this.look.scale));
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
