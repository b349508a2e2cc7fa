/* The age of information of every link: a row for each receiver, a column for each sender. */
"use strict";

(function (page) {
  const CLASSES = [1, 2, 4, 8, 16, 32]; // the oldest age in ticks of each class; then older
  const NUMBER_PX_MIN = 15;
  const SHADES = {
    light: ["#F2F6FA", "#CFE1F2", "#9CC4E4", "#5F9FD0", "#2E74B0", "#134A82", "#06213F"],
    dark: ["#1E2A38", "#23415F", "#2A5F8F", "#3B82BF", "#6AAAE0", "#A9D2F5", "#F0F8FF"],
  };
  const INK_ON = { light: ["#1B1F24", "#FFFFFF", 4], dark: ["#F1F3F5", "#0B0F14", 4] };

  const classOf = (age) => {
    const at = CLASSES.findIndex((most) => age <= most);
    return at < 0 ? CLASSES.length : at;
  };

  class Matrix {
    constructor(canvas, key, unit, look, onSelect) {
      Object.assign(this, { canvas, key, unit, look, cell: 1, gutter: 1, n: 0 });
      canvas.addEventListener("click", (event) => {
        const at = this.at(event);
        if (at) onSelect(at[0]);
      });
      canvas.addEventListener("mousemove", (event) => {
        const at = this.at(event);
        canvas.title = at ? this.words(...at) : "";
      });
    }

    at(event) {
      const row = Math.floor((event.offsetY - this.gutter) / this.cell);
      const column = Math.floor((event.offsetX - this.gutter) / this.cell);
      const inside = [row, column].every((k) => k >= 0 && k < this.n);
      return inside ? [row, column] : null;
    }

    words(receiver, sender) {
      const { robots } = this.stage;
      if (receiver === sender) return robots[receiver];
      const age = this.ages[receiver][sender];
      const ends = `packet of ${robots[sender]} that has reached ${robots[receiver]}`;
      if (age < 0) return `no ${ends}`;
      const s = (age * this.stage.tick_s).toFixed(1);
      return `newest ${ends}: ${page.counted(age, "tick")} old (${s} s)`;
    }

    /* Shows the ages of a frame. */
    draw(stage, frame, selected) {
      const { look } = this;
      const { ctx, width, height } = page.fittedCanvas(this.canvas);
      Object.assign(this, { stage, ages: frame.age, n: stage.robots.length });
      const n = this.n;
      this.gutter = (n > 24 ? 22 : 26) * look.scale;
      this.cell = Math.max(1, Math.min((width - this.gutter) / n, (height - this.gutter) / n));
      ctx.clearRect(0, 0, width, height);
      for (let row = 0; row < n; row += 1) {
        for (let column = 0; column < n; column += 1) this.drawCell(ctx, row, column);
      }
      this.drawNames(ctx, selected);
      if (selected !== null) {
        ctx.strokeStyle = look.colour("ink");
        ctx.lineWidth = 2;
        const y = this.gutter + selected * this.cell;
        ctx.strokeRect(this.gutter, y, n * this.cell, this.cell);
      }
    }

    drawCell(ctx, row, column) {
      const { look, gutter, cell } = this;
      const [x, y] = [gutter + column * cell, gutter + row * cell];
      const age = this.ages[row][column];
      const inner = cell > 5 ? cell - 1 : cell;
      if (row === column) return;
      if (age < 0) {
        ctx.strokeStyle = look.colour("line");
        ctx.lineWidth = 1;
        ctx.strokeRect(x + 0.5, y + 0.5, inner - 1, inner - 1);
        ctx.beginPath();
        ctx.moveTo(x + inner, y);
        ctx.lineTo(x, y + inner);
        ctx.stroke();
        return;
      }
      const shade = classOf(age);
      ctx.fillStyle = SHADES[look.theme][shade];
      ctx.fillRect(x, y, inner, inner);
      if (shade === 0 && cell > 8) {
        ctx.strokeStyle = look.colour("line");
        ctx.lineWidth = 0.6;
        ctx.strokeRect(x + 0.5, y + 0.5, inner - 1, inner - 1);
      }
      if (cell < NUMBER_PX_MIN) return;
      const [faint, strong, from] = INK_ON[look.theme];
      ctx.fillStyle = shade >= from ? strong : faint;
      ctx.font = look.font(Math.min(13, (0.62 * cell) / look.scale));
      ctx.textAlign = "center";
      ctx.textBaseline = "middle";
      ctx.fillText(age > 99 && cell < 22 ? "99+" : String(age), x + inner / 2, y + inner / 2 + 0.5);
    }

    drawNames(ctx, selected) {
      const { look, gutter, cell, n } = this;
      const px = Math.min(12, Math.max(9, 0.6 * cell));
      ctx.font = look.font(px, 700);
      const width = ctx.measureText(this.stage.robots[n - 1]).width + 2;
      const every = Math.max(1, Math.ceil((11 * look.scale) / cell));
      const everyColumn = Math.max(every, Math.ceil(width / cell));
      ctx.textBaseline = "middle";
      for (let k = 0; k < n; k += 1) {
        ctx.font = look.font(px, k === selected ? 700 : 400);
        ctx.fillStyle = look.colour(k === selected ? "ink" : "muted");
        const middle = gutter + (k + 0.5) * cell;
        ctx.textAlign = "right";
        if (k % every === 0 || k === selected) ctx.fillText(this.stage.robots[k], gutter - 4, middle);
        ctx.textAlign = "center";
        if (k % everyColumn === 0) ctx.fillText(this.stage.robots[k], middle, gutter - 0.55 * px - 2);
      }
    }

    /* The key of the shades, with ages in ticks and in s. */
    drawKey(stage) {
      const { look } = this;
      const shades = SHADES[look.theme];
      const [faint, strong, from] = INK_ON[look.theme];
      const boxes = shades.map((shade, k) => {
        const low = k === 0 ? 1 : CLASSES[k - 1] + 1;
        const text = k === CLASSES.length ? `≥ ${low}` : low === CLASSES[k] ? `${low}` : `${low}–${CLASSES[k]}`;
        const box = page.element("span", { class: "shade" }, text);
        box.style.background = shade;
        box.style.color = k >= from ? strong : faint;
        return box;
      });
      const never = page.element("span", { class: "shade never" }, "none");
      this.key.replaceChildren(...boxes, never);
      this.unit.textContent = `ticks of ${stage.tick_s} s; rows receive`;
    }
  }

  page.Matrix = Matrix;
})((window.encirclePage = window.encirclePage || {}));
