/* How things look: theme, size of type, and the shapes that stand beside every colour. */
"use strict";

(function (page) {
  const FONT = "system-ui, 'DejaVu Sans', sans-serif";
  const LARGE = 1.4;
  const OUTLINE_PX = 0.8;
  const ROBOT_SHAPES = ["disc", "square", "triangle", "diamond", "wedge", "cross"];
  const DASHES = [[], [7, 3], [7, 3, 2, 3], [2, 2], [10, 4], [5, 3]];

  /* Theme and size of type; told to all who listen as they change. */
  class Look {
    constructor() {
      this.large = false;
      this.listeners = [];
      this.systemDark = window.matchMedia("(prefers-color-scheme: dark)");
      this.chosen = null;
      this.systemDark.addEventListener("change", () => this.changed());
      this.changed();
    }

    get theme() {
      return this.chosen || (this.systemDark.matches ? "dark" : "light");
    }

    get scale() {
      return this.large ? LARGE : 1;
    }

    /* The colour of a role of the palette. */
    colour(role) {
      return page.palette.themes[this.theme][role];
    }

    setTheme(theme) {
      this.chosen = theme;
      this.changed();
    }

    setLarge(large) {
      this.large = large;
      this.changed();
    }

    /* A CSS font of the given size in px, before the switch to large type. */
    font(px, weight = 400) {
      return `${weight} ${Math.round(px * this.scale * 10) / 10}px ${FONT}`;
    }

    changed() {
      const root = document.documentElement;
      for (const [role, colour] of Object.entries(page.palette.themes[this.theme])) {
        root.style.setProperty(`--${role}`, colour);
      }
      root.dataset.theme = this.theme;
      root.dataset.type = this.large ? "large" : "normal";
      for (const listener of this.listeners) listener();
    }
  }

  /* A robot's colour, shape and dashes by its place in the robot order; as in the figures, robots
     of one colour differ in shape and dashes. */
  page.robotStyle = function (k) {
    const colours = page.palette.robots;
    const other = (k + Math.floor(k / colours.length)) % ROBOT_SHAPES.length;
    return { colour: colours[k % colours.length], shape: ROBOT_SHAPES[other], dash: DASHES[other] };
  };

  /* The look of a packet's fate: "arrived", "late" or the name of a cause of loss. */
  page.fateStyle = function (fate) {
    const { palette } = page;
    return palette[fate === "arrived" || fate === "late" ? fate : ""] || palette.lost[fate] || palette.unknownLoss;
  };

  function polygon(ctx, x, y, r, corners, turn) {
    for (let k = 0; k < corners; k += 1) {
      const angle = turn + (2 * Math.PI * k) / corners;
      ctx[k ? "lineTo" : "moveTo"](x + r * Math.cos(angle), y + r * Math.sin(angle));
    }
    ctx.closePath();
  }

  function spokes(ctx, x, y, r, arms, turn) {
    for (let k = 0; k < arms; k += 1) {
      const angle = turn + (Math.PI * k) / arms;
      const [dx, dy] = [r * Math.cos(angle), r * Math.sin(angle)];
      ctx.moveTo(x - dx, y - dy);
      ctx.lineTo(x + dx, y + dy);
    }
  }

  const FILLED = {
    disc: (ctx, x, y, r) => ctx.arc(x, y, r, 0, 2 * Math.PI),
    diamond: (ctx, x, y, r) => polygon(ctx, x, y, 1.25 * r, 4, 0),
    square: (ctx, x, y, r) => ctx.rect(x - 0.85 * r, y - 0.85 * r, 1.7 * r, 1.7 * r),
    triangle: (ctx, x, y, r) => polygon(ctx, x, y, 1.2 * r, 3, -Math.PI / 2),
    wedge: (ctx, x, y, r) => polygon(ctx, x, y, 1.2 * r, 3, Math.PI / 2),
    cross: (ctx, x, y, r) => {
      const arm = 0.38 * r;
      const corners = [[-arm, -r], [arm, -r], [arm, -arm], [r, -arm], [r, arm], [arm, arm], [arm, r]];
      corners.push([-arm, r], [-arm, arm], [-r, arm], [-r, -arm], [-arm, -arm]);
      corners.forEach(([dx, dy], k) => ctx[k ? "lineTo" : "moveTo"](x + dx, y + dy));
      ctx.closePath();
    },
  };
  const STROKED = {
    x: (ctx, x, y, r) => spokes(ctx, x, y, r, 2, Math.PI / 4),
    plus: (ctx, x, y, r) => spokes(ctx, x, y, r, 2, 0),
    star: (ctx, x, y, r) => spokes(ctx, x, y, r, 3, Math.PI / 2),
    bar: (ctx, x, y, r) => spokes(ctx, x, y, r, 1, Math.PI / 2),
    "ring-x": (ctx, x, y, r) => {
      spokes(ctx, x, y, 0.7 * r, 2, Math.PI / 4);
      ctx.moveTo(x + 1.15 * r, y);
      ctx.arc(x, y, 1.15 * r, 0, 2 * Math.PI);
    },
    "box-x": (ctx, x, y, r) => {
      spokes(ctx, x, y, 0.8 * r, 2, Math.PI / 4);
      ctx.rect(x - r, y - r, 2 * r, 2 * r);
    },
  };

  /* Draws a shape of radius r about (x, y). Filled ones have an outline if its colour is given, as
     orange and sky blue alone do not stand out from white. */
  page.drawShape = function (ctx, shape, x, y, r, colour, { lineWidth = 1.6, outline = null } = {}) {
    ctx.beginPath();
    (FILLED[shape] || STROKED[shape] || STROKED.x)(ctx, x, y, r);
    ctx.fillStyle = ctx.strokeStyle = colour;
    ctx.lineWidth = lineWidth;
    if (!FILLED[shape]) ctx.stroke();
    else {
      ctx.fill();
      if (!outline) return;
      ctx.strokeStyle = outline;
      ctx.lineWidth = OUTLINE_PX;
      ctx.stroke();
    }
  };

  /* A canvas element that shows a shape, for legends; the words beside it say the same. */
  page.shapeIcon = function (shape, colour, sizePx, outline = null) {
    const ratio = window.devicePixelRatio || 1;
    const icon = document.createElement("canvas");
    icon.width = icon.height = Math.round(sizePx * ratio);
    icon.style.width = icon.style.height = `${sizePx}px`;
    icon.setAttribute("aria-hidden", "true");
    const ctx = icon.getContext("2d");
    ctx.scale(ratio, ratio);
    page.drawShape(ctx, shape, sizePx / 2, sizePx / 2, 0.32 * sizePx, colour, { outline });
    return icon;
  };

  /* A text with a rim in the background's colour, legible over whatever is below it. */
  page.drawLabel = function (ctx, text, x, y, colour, rim) {
    ctx.lineJoin = "round";
    ctx.lineWidth = 3;
    ctx.strokeStyle = rim;
    ctx.strokeText(text, x, y);
    ctx.fillStyle = colour;
    ctx.fillText(text, x, y);
  };

  const PLACES = [[1, -1], [-1, -1], [1, 1], [-1, 1], [0, -1], [0, 1]];
  const overlap = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

  /* Puts labels beside bodies where they cover no other label. One that was somewhere in the frame
     before stays there if it can. */
  class Labels {
    constructor() {
      this.last = new Map();
      this.boxes = [];
    }

    begin() {
      this.boxes = [];
    }

    /* Keeps labels off a disc. */
    keepOff(x, y, radius) {
      this.boxes.push([x - radius, y - radius, x + radius, y + radius]);
    }

    /* Draws a text beside a body of a radius at (x, y); key names the label from frame to frame. */
    draw(view, key, text, x, y, radius) {
      const { ctx, look } = view;
      const width = ctx.measureText(text).width;
      const height = 14 * look.scale;
      const boxOf = ([sx, sy]) => {
        const left = x - width / 2 + sx * (radius + 4 + width / 2);
        const middle = y + sy * (radius + (sx ? 2 : 9));
        return [left, middle - height / 2, left + width, middle + height / 2];
      };
      const before = this.last.get(key) || 0;
      const order = [before, ...PLACES.keys()];
      const covered = (k) => this.boxes.filter((box) => overlap(box, boxOf(PLACES[k]))).length;
      let [place, least] = [before, Infinity];
      for (const k of order) {
        const count = covered(k);
        if (count < least) [place, least] = [k, count];
        if (!least) break;
      }
      this.last.set(key, place);
      const box = boxOf(PLACES[place]);
      this.boxes.push(box);
      ctx.textAlign = "left";
      ctx.textBaseline = "middle";
      page.drawLabel(ctx, text, box[0], (box[1] + box[3]) / 2, look.colour("ink"), look.colour("background"));
    }
  }

  page.Labels = Labels;
  page.Look = Look;
})((window.encirclePage = window.encirclePage || {}));
