/* Every act of the page by key, and the panel that lists the keys. */
"use strict";

(function (page) {
  const FAR_TICKS = 10;
  const ticks = (far) => (far ? FAR_TICKS : 1);

  /* Keys, what the help says of them, and what they do to the page's acts. */
  const KEYS = [
    { keys: [" ", "k"], label: "Space", text: "play or pause", act: (p) => p.toggle() },
    { keys: ["ArrowLeft"], label: "←", text: "one tick back; with Shift ten", act: (p, far) => p.step(-ticks(far)) },
    { keys: ["ArrowRight"], label: "→", text: "one tick on; with Shift ten", act: (p, far) => p.step(ticks(far)) },
    { keys: ["Home"], label: "Home", text: "first tick", act: (p) => p.seek(0) },
    { keys: ["End"], label: "End", text: "last tick", act: (p) => p.seek(Infinity) },
    { keys: ["n"], label: "n", text: "next event", act: (p) => p.event(true) },
    { keys: ["b"], label: "b", text: "event before", act: (p) => p.event(false) },
    { keys: ["-", "_"], label: "−", text: "slower", act: (p) => p.changeSpeed(-1) },
    { keys: ["+", "="], label: "+", text: "faster", act: (p) => p.changeSpeed(1) },
    { keys: ["l"], label: "l", text: "follow the live edge", act: (p) => p.follow() },
    { keys: ["]", "ArrowDown"], label: "] or ↓", text: "the world as believed by the next", act: (p) => p.selectBy(1) },
    { keys: ["[", "ArrowUp"], label: "[ or ↑", text: "… by the one before", act: (p) => p.selectBy(-1) },
    { keys: ["Escape", "0"], label: "Esc", text: "the truth", act: (p) => p.select(null) },
    { keys: ["p"], label: "p", text: "packets", act: (p) => p.switchLayer("packets") },
    { keys: ["o"], label: "o", text: "only packets of the picked robot", act: (p) => p.switchLayer("own") },
    { keys: ["t"], label: "t", text: "trails", act: (p) => p.switchLayer("trails") },
    { keys: ["r"], label: "r", text: "ring and stop distance", act: (p) => p.switchLayer("rings") },
    { keys: ["g"], label: "g", text: "goals", act: (p) => p.switchLayer("goals") },
    { keys: ["z"], label: "z", text: "whole arena, or close by", act: (p) => p.switchView() },
    { keys: ["d"], label: "d", text: "dark or light", act: (p) => p.switchTheme() },
    { keys: ["x"], label: "x", text: "large type, for a projector", act: (p) => p.switchType() },
    { keys: ["?", "h"], label: "?", text: "this panel", act: (p) => p.help() },
  ];

  /* Lets keys act, but in fields that take keys themselves. */
  page.listenToKeys = function (acts) {
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey) return;
      const { target } = event;
      const range = target.matches("input[type=range]");
      if (target.matches("select, textarea") || (target.matches("input") && !range)) return;
      if (range && target.id !== "slider") return;
      if (target.matches("button, summary") && [" ", "Enter"].includes(event.key)) return;
      if (document.querySelector("dialog[open]") && event.key === "Escape") return;
      const digit = /^[1-9]$/.test(event.key);
      const key = KEYS.find(({ keys }) => keys.includes(event.key));
      if (!digit && !key) return;
      event.preventDefault();
      if (digit) acts.select(Number(event.key) - 1);
      else key.act(acts, event.shiftKey);
    });
  };

  /* Rows for the help panel. */
  page.keyRows = function () {
    const rows = KEYS.map(({ label, text }) => [label, text]);
    rows.splice(10, 0, ["1 … 9", "the world as believed by r1 … r9"]);
    return rows.map(([label, text]) =>
      page.element("tr", {}, page.element("td", {}, page.element("kbd", {}, label)), page.element("td", {}, text)),
    );
  };
})((window.encirclePage = window.encirclePage || {}));
