/* Curves over time, drawn by Bokeh. The cursor at the present tick is an element of our own over
   each chart, so that moving it draws no chart anew. */
"use strict";

(function (page) {
  const LINES_MAX = 16;
  const LEFT_PX = 44;
  const RIGHT_PX = 10;
  const ROOM = 1.25; // The time axis of what goes on grows by this, not with every tick.
  const SPAN_S_MIN = 2;
  const FILL_MS_MIN = 500; // A chart takes in what comes live no more often than this,
  const TURN_MS = 50; // and the next chart so much later.
  const DOT_PX = 3;
  const DEGREES = 180 / Math.PI;
  const known = (value, factor = 1) => (value === null || value === undefined ? NaN : value * factor);
  const shown = (value, digits) => (Number.isFinite(value) ? value.toFixed(digits) : "–");

  /* One entry per chart: columns of a frame's values, a level that matters, what to read off. */
  function chartsOf(stage) {
    return [
      {
        id: "distance", from: 0,
        title: stage.robots.length > LINES_MAX ? "Nearest, middle, farthest (m)" : "Distance to target (m)",
        level: stage.stop_distance_m, levelText: `stop ${stage.stop_distance_m} m`,
        of: (val) => val.d, read: (d) => `${shown(Math.min(...d), 1)} to ${shown(Math.max(...d), 1)}`,
      },
      {
        id: "gap", title: "Largest gap (°)", from: 0, level: 180, levelText: "open from 180° on",
        of: (val) => [known(val.gap, DEGREES)], read: ([v]) => shown(v, 0),
      },
      {
        id: "slack", title: "Slack of the ring (°)", level: 0, levelText: "closed above 0°",
        of: (val) => [known(val.slack, DEGREES)], read: ([v]) => shown(v, 0),
      },
      {
        id: "age", title: "Mean age of information (ticks)", from: 0,
        of: (val) => [known(val.age)], read: ([v]) => shown(v, 1),
      },
      {
        id: "conflicts", title: "Conflicts (pairs with one goal)", from: 0, least: 1.2,
        of: (val) => [known(val.conf)], read: ([v]) => shown(v, 0),
      },
      {
        id: "delivery", title: "Delivered, last 20 ticks (%)", from: 0, to: 104,
        of: (val) => [known(val.del, 100)], read: ([v]) => shown(v, 0),
      },
    ];
  }

  class Charts {
    /* onSeek(tick) is called by a press; redraw() when the charts have something to take in. */
    constructor(element, look, onSeek, redraw) {
      Object.assign(this, { element, look, onSeek, redraw, panels: [], version: -1, end: 0 });
      this.waits = false;
    }

    /* Builds all charts for the model's run. */
    build(model) {
      this.model = model;
      this.version = model.version;
      for (const { view } of this.panels) if (view) view.remove();
      this.element.replaceChildren();
      this.end = this.endOf(model);
      this.panels = chartsOf(model.stage).map((chart, k, all) =>
        this.panel(chart, k === all.length - 1),
      );
    }

    endOf(model) {
      const s = model.lastTick * model.stage.tick_s;
      if (model.status.state === "ended") return Math.max(s, model.stage.tick_s);
      return s <= this.end ? this.end : Math.max(SPAN_S_MIN, s * ROOM);
    }

    panel(chart, lowest) {
      const value = page.element("span", { class: "value" });
      const level = page.element("span", { class: "level" }, chart.levelText ? `┄ ${chart.levelText}` : "");
      const caption = page.element("figcaption", {}, page.element("b", {}, chart.title), value, level);
      const cursor = page.element("div", { class: "cursor" });
      const drawn = page.element("div", { class: "drawn" });
      const plot = page.element("div", { class: "plot" }, drawn, cursor);
      const attributes = { class: lowest ? "chart lowest" : "chart", id: `chart-${chart.id}` };
      this.element.append(page.element("figure", attributes, caption, plot));
      const names = this.names(chart);
      const panel = { chart, names, value, cursor, plot, filled: 0, filledMs: -Infinity, view: null };
      Object.assign(panel, { source: this.columns(names), dots: this.columns(names) });
      panel.range = new Bokeh.Range1d({ start: 0, end: this.end });
      this.fill(panel);
      const figure = this.figure(panel, lowest);
      Bokeh.Plotting.show(figure, drawn).then((view) => {
        panel.view = view;
        this.moveCursor(this.at || 0);
      });
      this.listen(plot, panel);
      return panel;
    }

    /* Columns of a chart; of a large team nearest, middle and farthest stand for all robots. */
    names(chart) {
      if (chart.id !== "distance") return ["v0"];
      const n = this.model.stage.robots.length;
      return Array.from({ length: n <= LINES_MAX ? n : 3 }, (_, k) => `v${k}`);
    }

    values(chart, frame) {
      const values = chart.of(frame.val);
      // At its last tick a run has no decisions, and so no conflicts that could be counted.
      if (chart.id === "conflicts" && frame.mode.every((mode) => mode === null)) return [NaN];
      if (values.length <= LINES_MAX) return values;
      const sorted = [...values].sort((a, b) => a - b);
      return [sorted[0], sorted[Math.floor(sorted.length / 2)], sorted[sorted.length - 1]];
    }

    /* A source of Bokeh's with a column for the time and one for each name. */
    columns(names) {
      return new Bokeh.ColumnDataSource({ data: Object.fromEntries(["s", ...names].map((name) => [name, []])) });
    }

    /* Adds the ticks that a chart does not have yet. Ticks that were missed are a gap in its lines,
       and a tick alone between two gaps, which is no line, is a dot. */
    fill(panel) {
      const { model } = this;
      const { frames } = model;
      const lines = [];
      const dots = [];
      for (let t = Math.max(panel.filled, model.firstTick); t < frames.length; t += 1) {
        if (frames[t]) lines.push([t, this.values(panel.chart, frames[t])]);
        else if (frames[t - 1]) {
          lines.push([t, panel.names.map(() => NaN)]);
          if (!frames[t - 2]) dots.push([t - 1, this.values(panel.chart, frames[t - 1])]);
        }
      }
      panel.filled = frames.length;
      for (const [source, rows] of [[panel.source, lines], [panel.dots, dots]]) {
        if (!rows.length) continue;
        const columns = panel.names.map((name, k) => [name, rows.map(([, values]) => values[k])]);
        source.stream({ s: rows.map(([t]) => t * model.stage.tick_s), ...Object.fromEntries(columns) });
      }
    }

    figure(panel, lowest) {
      const { look } = this;
      const { chart, names } = panel;
      const range = { range_padding: 0.12 };
      if (chart.from !== undefined) range.start = chart.from;
      if (chart.to !== undefined) range.end = chart.to;
      if (chart.least) range.min_interval = chart.least;
      const figure = Bokeh.Plotting.figure({
        tools: "", toolbar_location: null, sizing_mode: "stretch_both",
        x_range: panel.range, y_range: new Bokeh.DataRange1d(range),
        min_border_left: LEFT_PX * look.scale, min_border_right: RIGHT_PX,
        min_border_top: 3, min_border_bottom: lowest ? 38 * look.scale : 8,
        background_fill_color: look.colour("background"), border_fill_color: look.colour("panel"),
        outline_line_color: look.colour("line"),
      });
      this.styleAxes(figure, lowest);
      if (chart.level !== undefined) {
        figure.add_layout(new Bokeh.Span({
          location: chart.level, dimension: "width",
          line_color: look.colour("muted"), line_dash: [4, 3], line_width: 1,
        }));
      }
      const many = names.length > 1;
      names.forEach((name, k) => {
        const style = many ? page.robotStyle(k) : { colour: look.colour("arrived"), dash: [] };
        const line = {
          source: panel.source, line_color: style.colour, line_width: many ? 1.4 : 1.8,
          line_dash: names.length > 8 ? [] : style.dash,
        };
        const [x, y] = [{ field: "s" }, { field: name }];
        if (chart.id === "conflicts") figure.step(x, y, "after", line);
        else figure.line(x, y, line);
        const dot = { source: panel.dots, size: DOT_PX, line_color: null, fill_color: style.colour };
        figure.scatter(x, y, dot);
      });
      return figure;
    }

    styleAxes(figure, lowest) {
      const { look } = this;
      const px = `${Math.round(11 * look.scale)}px`;
      const [line, muted, font] = [look.colour("line"), look.colour("muted"), "system-ui, sans-serif"];
      for (const axis of [...figure.xaxes, ...figure.yaxes]) {
        Object.assign(axis, {
          axis_line_color: line, major_tick_line_color: line, minor_tick_line_color: null,
          major_label_text_color: muted, major_label_text_font_size: px, major_label_text_font: font,
          axis_label_text_color: muted, axis_label_text_font_size: px, axis_label_text_font: font,
          axis_label_text_font_style: "normal", axis_label_standoff: 1, major_label_standoff: 3,
          major_tick_in: 0, major_tick_out: 3,
        });
      }
      for (const axis of figure.yaxes) axis.ticker.desired_num_ticks = 3;
      for (const axis of figure.xaxes) {
        if (lowest) axis.axis_label = "time (s)";
        else axis.visible = false;
      }
      for (const grid of [...figure.xgrids, ...figure.ygrids]) grid.grid_line_color = look.colour("grid");
    }

    /* A press or a drag on a chart goes to that time. */
    listen(plot, panel) {
      const seek = (event) => {
        const box = this.frameBox(panel);
        if (!box) return;
        const share = (event.clientX - plot.getBoundingClientRect().left - box.left) / box.width;
        this.onSeek(Math.round((Math.min(1, Math.max(0, share)) * panel.range.end) / this.model.stage.tick_s));
      };
      plot.addEventListener("pointerdown", (event) => {
        plot.setPointerCapture(event.pointerId);
        seek(event);
      });
      plot.addEventListener("pointermove", (event) => {
        if (event.buttons) seek(event);
      });
    }

    frameBox(panel) {
      const box = panel.view && panel.view.frame && panel.view.frame.bbox;
      return box && box.width > 0 ? box : null;
    }

    /* Takes in what has come since, and moves the cursors to a time in ticks. */
    update(model, time, moment) {
      if (model.version !== this.version) this.build(model);
      this.fillInTime(model);
      if (model.status.state === "ended") for (const panel of this.panels) panel.range.end = this.endOf(model);
      for (const { chart, value } of this.panels) {
        page.setText(value, chart.read(this.values(chart, moment.frame)));
      }
      this.moveCursor(time);
    }

    /* One chart at a time takes in what has come: to draw one anew takes Bokeh some ms. */
    fillInTime(model) {
      const behind = this.panels.filter((panel) => panel.filled < model.frames.length);
      if (!behind.length) return;
      const next = behind.reduce((first, panel) => (panel.filledMs < first.filledMs ? panel : first));
      const early = FILL_MS_MIN - (performance.now() - next.filledMs);
      if (early <= 0) {
        next.filledMs = performance.now();
        this.end = this.endOf(model);
        this.fill(next);
        next.range.end = this.end;
      }
      if (!this.waits) setTimeout(() => Object.assign(this, { waits: false }).redraw(), Math.max(early, TURN_MS));
      this.waits = true;
    }

    moveCursor(time) {
      this.at = time;
      for (const panel of this.panels) {
        const box = this.frameBox(panel);
        const share = Math.min(1, (time * this.model.stage.tick_s) / panel.range.end);
        panel.cursor.hidden = !box;
        if (!box) continue;
        panel.cursor.style.transform = `translateX(${(box.left + share * box.width).toFixed(1)}px)`;
        panel.cursor.style.top = `${box.top}px`;
        panel.cursor.style.height = `${box.height}px`;
      }
    }

    /* After a change of theme or type. */
    restyle() {
      if (this.model) this.build(this.model);
    }
  }

  page.Charts = Charts;
})((window.encirclePage = window.encirclePage || {}));
