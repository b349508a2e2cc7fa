/* Elements. Text of others, such as titles and names, only ever becomes text, never markup. */
"use strict";

(function (page) {
  page.byId = (id) => document.getElementById(id);

  /* An element with attributes and children; children are elements or texts. */
  page.element = function (tag, attributes = {}, ...children) {
    const made = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (value === null || value === undefined || value === false) continue;
      made.setAttribute(name, value === true ? "" : String(value));
    }
    made.append(...children);
    return made;
  };

  /* Sets an element's text, and touches nothing if it is that already. */
  page.setText = function (element, text) {
    if (element.textContent !== text) element.textContent = text;
  };

  /* "1 tick", "2 ticks". */
  page.counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

  /* Fits a canvas to its size on screen; returns its context, scaled to CSS pixels, and the size. */
  page.fittedCanvas = function (canvas) {
    const ratio = window.devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = canvas;
    const [w, h] = [Math.max(1, Math.round(width * ratio)), Math.max(1, Math.round(height * ratio))];
    if (canvas.width !== w || canvas.height !== h) {
      canvas.width = w;
      canvas.height = h;
    }
    const ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    return { ctx, width, height };
  };
})((window.encirclePage = window.encirclePage || {}));
