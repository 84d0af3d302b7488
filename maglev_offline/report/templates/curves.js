"use strict";
// What is folded is printed, too.
window.addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((part) => { part.open = true; }));

// Learning curves that a reader can question: hover or arrow keys read them, a drag zooms, boxes choose arms.

for (const root of document.querySelectorAll(".live")) {
  const data = JSON.parse(root.querySelector("script").textContent);
  const steps = data.steps;
  const shown = new Set(data.arms.filter((arm) => arm.shown).map((arm) => arm.name));
  const view = { from: 0, to: steps[steps.length - 1], at: steps.length - 1, runs: false, log: true };
  const WIDTH = 480, HEIGHT = 340, LEFT = 46, RIGHT = 10, TOP = 8, BOTTOM = 34;
  const SVG = "http://www.w3.org/2000/svg";

  // --- words and numbers ---

  const digits = (value) => (value === null ? "none" : Number(value.toPrecision(3)).toLocaleString("en", { maximumSignificantDigits: 3 }));
  const whole = (value) => Math.round(value).toLocaleString("en");

  function told(panel, arm) {
    const line = panel.arms[arm.name], k = view.at;
    const interval = line.low[k] === null ? "" : ` (${digits(line.low[k])} to ${digits(line.high[k])})`;
    return `${arm.label} ${digits(line.middle[k])}${interval}`;
  }

  function reading(panel) {
    const parts = chosen(panel).map((arm) => told(panel, arm));
    return `${whole(steps[view.at])} steps: ${parts.join("; ") || "no arm is chosen"}`;
  }

  // --- geometry ---

  const chosen = (panel) => data.arms.filter((arm) => shown.has(arm.name) && panel.arms[arm.name]);
  const inside = () => steps.flatMap((step, k) => (step >= view.from && step <= view.to ? [k] : []));

  function range() {
    // One range for all panels, so that heights compare; the lines of classical control are always in it.
    let low = Infinity, high = -Infinity;
    const take = (cost) => { if (cost !== null) { low = Math.min(low, cost); high = Math.max(high, cost); } };
    const places = inside();
    for (const line of data.references) take(line.cost);
    take(data.threshold);
    for (const panel of data.panels) for (const arm of chosen(panel)) {
      const line = panel.arms[arm.name];
      const rows = view.runs ? line.runs : [line.low, line.high, line.middle];
      for (const row of rows) for (const k of places) take(row[k]);
    }
    if (low > high) return view.log ? [1, 10] : [0, 1];
    return view.log ? [low / 1.1, high * 1.1] : [0, high * 1.05];
  }

  const x = (step) => LEFT + ((step - view.from) / (view.to - view.from)) * (WIDTH - LEFT - RIGHT);
  const stepAt = (place) => view.from + ((place - LEFT) / (WIDTH - LEFT - RIGHT)) * (view.to - view.from);
  function scale([low, high]) {
    const bend = view.log ? Math.log : (value) => value;
    return (cost) => HEIGHT - BOTTOM - ((bend(cost) - bend(low)) / (bend(high) - bend(low))) * (HEIGHT - TOP - BOTTOM);
  }

  function ticks(low, high, many, log) {
    if (log) {
      const found = [];
      for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++)
        for (const times of high / low > 200 ? [1] : high / low > 12 ? [1, 2, 5] : [1, 1.5, 2, 3, 4, 5, 6, 7, 8, 9]) found.push(times * 10 ** power);
      return found.filter((value) => value >= low && value <= high);
    }
    const rough = (high - low) / many, power = 10 ** Math.floor(Math.log10(rough));
    const stride = [1, 2, 2.5, 5, 10].map((times) => times * power).find((value) => value >= rough);
    const found = [];
    for (let value = Math.ceil(low / stride) * stride; value <= high * (1 + 1e-9); value += stride) found.push(value);
    return found;
  }

  // --- drawing ---

  function put(parent, tag, attributes, text) {
    const made = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
    if (text !== undefined) made.textContent = text;
    parent.append(made);
    return made;
  }

  function path(row, y) {
    let pen = "M", text = "";
    row.forEach((cost, k) => {
      if (cost === null) { pen = "M"; return; }
      text += `${pen}${x(steps[k]).toFixed(1)} ${y(cost).toFixed(1)}`;
      pen = "L";
    });
    return text;
  }

  function band(line, y) {
    const known = steps.flatMap((_, k) => (line.low[k] === null || line.high[k] === null ? [] : [k]));
    const there = known.map((k) => `${x(steps[k]).toFixed(1)} ${y(line.high[k]).toFixed(1)}`);
    const back = known.reverse().map((k) => `${x(steps[k]).toFixed(1)} ${y(line.low[k]).toFixed(1)}`);
    return there.length ? `M${there.join("L")}L${back.join("L")}Z` : "";
  }

  function draw() {
    const [low, high] = range();
    const y = scale([low, high]);
    view.range = [low, high];
    panels.forEach(({ panel, svg }, place) => {
      svg.replaceChildren();
      put(put(svg, "clipPath", { id: `${root.id}-clip-${place}` }), "rect",
        { x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM });
      if (data.exploratory > view.from) put(svg, "rect", { x: LEFT, y: TOP, height: HEIGHT - TOP - BOTTOM, fill: "#f1f3f5",
        width: Math.max(0, Math.min(x(data.exploratory), WIDTH - RIGHT) - LEFT) });
      for (const value of ticks(low, high, 5, view.log)) {
        put(svg, "line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value), stroke: "#e6e8eb" });
        put(svg, "text", { x: LEFT - 6, y: y(value) + 4, "text-anchor": "end", fill: "#59636e" }, digits(value));
      }
      for (const value of ticks(view.from, view.to, 4, false)) {
        put(svg, "line", { x1: x(value), x2: x(value), y1: HEIGHT - BOTTOM, y2: HEIGHT - BOTTOM + 4, stroke: "#59636e" });
        put(svg, "text", { x: Math.min(x(value), WIDTH - 24), y: HEIGHT - BOTTOM + 17, "text-anchor": "middle", fill: "#59636e" }, whole(value));
      }
      put(svg, "text", { x: (WIDTH + LEFT) / 2, y: HEIGHT - 2, "text-anchor": "middle", fill: "#59636e" }, "environment steps");
      const plot = put(svg, "g", { "clip-path": `url(#${root.id}-clip-${place})`, fill: "none", "stroke-linejoin": "round" });
      for (const line of data.references)
        put(plot, "line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(line.cost), y2: y(line.cost), stroke: line.colour, "stroke-dasharray": line.dash });
      if (data.threshold !== null)
        put(plot, "line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(data.threshold), y2: y(data.threshold), stroke: "#1f2328", "stroke-dasharray": "1 3" });
      for (const arm of chosen(panel)) {
        const line = panel.arms[arm.name];
        if (view.runs) for (const run of line.runs) put(plot, "path", { d: path(run, y), stroke: arm.colour, "stroke-width": 0.7, opacity: 0.4 });
        else put(plot, "path", { d: band(line, y), fill: arm.colour, opacity: 0.16 });
        put(plot, "path", { d: path(line.middle, y), stroke: arm.colour, "stroke-width": 2, "stroke-dasharray": arm.dash, "data-arm": arm.name });
      }
      put(svg, "rect", { x: LEFT, y: TOP, width: WIDTH - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM, fill: "none", stroke: "#8c959f", "stroke-width": 0.6 });
      put(svg, "line", { y1: TOP, y2: HEIGHT - BOTTOM, stroke: "#1f2328", "stroke-width": 0.8, class: "cursor" });
      put(svg, "rect", { y: TOP, height: HEIGHT - TOP - BOTTOM, width: 0, fill: "#0b5394", opacity: 0.12, class: "drag" });
    });
    root.dataset.from = Math.round(view.from);
    root.dataset.to = Math.round(view.to);
    read();
  }

  function read() {
    // What moves with the pointer; the curves stay as they are drawn.
    const at = x(steps[view.at]);
    for (const { panel, svg, box, words } of panels) {
      const cursor = svg.querySelector(".cursor");
      cursor.setAttribute("x1", at);
      cursor.setAttribute("x2", at);
      words.replaceChildren(...readings(panel));
      box.setAttribute("aria-valuenow", view.at);
      box.setAttribute("aria-valuetext", reading(panel));
    }
    root.dataset.at = steps[view.at];
  }

  function readings(panel) {
    const head = document.createElement("b");
    head.textContent = `${whole(steps[view.at])} steps`;
    const lines = chosen(panel).map((arm) => {
      const row = document.createElement("span");
      row.append(swatch(arm), ` ${told(panel, arm)}`);
      return row;
    });
    return [head, ...lines];
  }

  function swatch(arm) {
    const made = document.createElementNS(SVG, "svg");
    for (const [name, value] of Object.entries({ viewBox: "0 0 22 8", width: 22, height: 8, class: "swatch", "aria-hidden": "true" })) made.setAttribute(name, value);
    put(made, "line", { x1: 1, x2: 21, y1: 4, y2: 4, stroke: arm.colour, "stroke-width": 2.4, "stroke-dasharray": arm.dash });
    return made;
  }

  // --- the hand ---

  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  const nearest = (step) => steps.reduce((best, value, k) => (Math.abs(value - step) < Math.abs(steps[best] - step) ? k : best), 0);

  function zoom(from, to) {
    const last = steps[steps.length - 1], least = steps.length > 2 ? 2 * (steps[2] - steps[1]) : last;
    const width = clamp(to - from, Math.min(least, last), last);
    view.from = clamp(from, 0, last - width);
    view.to = view.from + width;
    if (steps[view.at] < view.from || steps[view.at] > view.to) view.at = nearest((view.from + view.to) / 2);
    draw();
  }
  const whence = () => zoom(0, steps[steps.length - 1]);
  const closer = (factor) => {
    const middle = steps[view.at], half = (factor * (view.to - view.from)) / 2;
    zoom(middle - half, middle + half);
  };

  function run(panel, step, cost) {
    // The run nearest to the hand: its seed, and the artefact that holds it.
    let best = null;
    const k = nearest(step);
    for (const arm of chosen(panel)) panel.arms[arm.name].runs.forEach((row, place) => {
      if (row[k] === null) return;
      const far = Math.abs(Math.log(row[k] / cost));
      if (!best || far < best.far) best = { far, arm, place, cost: row[k] };
    });
    if (!best) return "";
    const line = panel.arms[best.arm.name], block = data.blocks[line.blocks[best.place]];
    return `Nearest run: ${panel.name}, ${best.arm.label}, seed ${line.seeds[best.place]}, cost ${digits(best.cost)}`
      + (block ? ` (${block.name}, ${block.hash})` : "");
  }

  const panels = data.panels.map((panel) => {
    const box = document.createElement("div"), title = document.createElement("b"), words = document.createElement("div");
    const svg = document.createElementNS(SVG, "svg");
    svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
    box.className = "panel";
    title.textContent = panel.name;
    words.className = "reading";
    for (const [name, value] of Object.entries({ tabindex: 0, role: "slider", "aria-valuemin": 0, "aria-valuemax": steps.length - 1,
      "aria-label": `${panel.name}: cost by evaluation; arrow keys read, plus and minus zoom, escape shows all` })) box.setAttribute(name, value);
    box.append(title, svg, words);
    let start = null;
    const shade = (from, to) => {
      const drag = svg.querySelector(".drag");
      drag.setAttribute("x", Math.min(from, to));
      drag.setAttribute("width", Math.abs(from - to));
    };
    const place = (event) => {
      const seen = svg.getBoundingClientRect();
      return [((event.clientX - seen.left) / seen.width) * WIDTH, ((event.clientY - seen.top) / seen.height) * HEIGHT];
    };
    svg.addEventListener("pointermove", (event) => {
      const [across, down] = place(event);
      look(across, down);
      if (start !== null) shade(start, clamp(across, LEFT, WIDTH - RIGHT));
    });
    const look = (across, down) => {
      view.at = nearest(clamp(stepAt(clamp(across, LEFT, WIDTH - RIGHT)), view.from, view.to));
      read();
      const [low, high] = view.range, share = (HEIGHT - BOTTOM - down) / (HEIGHT - TOP - BOTTOM);
      const cost = view.log ? low * (high / low) ** share : low + share * (high - low);
      if (view.runs) nearby.textContent = run(panel, stepAt(across), Math.max(cost, 1e-9));
    };
    svg.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      const [across, down] = place(event);
      look(across, down);
      if (event.pointerType === "touch") return; // a finger scrolls and reads; buttons and two fingers zoom
      start = clamp(across, LEFT, WIDTH - RIGHT);
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointercancel", () => { start = null; shade(0, 0); });
    svg.addEventListener("pointerup", (event) => {
      if (start === null) return;
      const ends = [start, clamp(place(event)[0], LEFT, WIDTH - RIGHT)].map(stepAt);
      start = null;
      shade(0, 0);
      if (Math.abs(ends[0] - ends[1]) > 0.02 * (view.to - view.from)) zoom(Math.min(...ends), Math.max(...ends));
    });
    svg.addEventListener("dblclick", whence);
    box.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return; // those are the browser's own
      const moves = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -5, PageUp: 5, Home: -Infinity, End: Infinity };
      if (event.key in moves) {
        const places = inside();
        view.at = clamp(view.at + moves[event.key], places[0], places[places.length - 1]);
        read();
      } else if (event.key === "+" || event.key === "=") closer(0.5);
      else if (event.key === "-") closer(2);
      else if (event.key === "Escape" || event.key === "0") whence();
      else return;
      event.preventDefault();
    });
    return { panel, svg, box, words };
  });

  // --- the controls ---

  function checkbox(text, on, change, mark) {
    const made = document.createElement("label"), box = document.createElement("input");
    box.type = "checkbox";
    box.checked = on;
    box.addEventListener("change", () => { change(box.checked); draw(); });
    made.append(box, ...(mark ? [mark] : []), ` ${text}`);
    return made;
  }

  function button(text, press) {
    const made = document.createElement("button");
    made.type = "button";
    made.textContent = text;
    made.addEventListener("click", press);
    return made;
  }

  const boxes = data.arms.map((arm) =>
    checkbox(arm.label, shown.has(arm.name), (on) => (on ? shown.add(arm.name) : shown.delete(arm.name)), swatch(arm)));
  function all(on) {
    data.arms.forEach((arm, k) => {
      boxes[k].querySelector("input").checked = on;
      if (on) shown.add(arm.name); else shown.delete(arm.name);
    });
    draw();
  }
  const arms = document.createElement("fieldset"), legend = document.createElement("legend");
  legend.textContent = "Arms";
  arms.append(legend, ...boxes, button("all", () => all(true)), button("none", () => all(false)));
  const how = document.createElement("div");
  how.className = "how";
  how.append(
    checkbox("every run", false, (on) => { view.runs = on; nearby.textContent = ""; }),
    checkbox("logarithmic cost", true, (on) => { view.log = on; }),
    button("zoom in", () => closer(0.5)), button("zoom out", () => closer(2)), button("whole training", whence));
  const lines = document.createElement("p");
  lines.className = "lines";
  for (const line of [...data.references, ...(data.threshold === null ? [] : [{ label: "threshold", colour: "#1f2328", dash: "1 3", cost: data.threshold }])]) {
    const part = document.createElement("span");
    part.append(swatch(line), ` ${line.label} ${digits(line.cost)}`);
    lines.append(part, " ");
  }
  const nearby = document.createElement("p");
  nearby.className = "nearby";
  const row = document.createElement("div");
  row.className = "panels";
  row.append(...panels.map((one) => one.box));
  root.append(arms, how, lines, row, nearby);
  root.closest("figure").classList.add("alive");
  draw();
}
