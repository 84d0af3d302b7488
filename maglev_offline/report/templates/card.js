
"use strict";
// The rows of the sample, rules over them, and the recipe tables that do the same to all rows.

const data = JSON.parse(document.getElementById("data").textContent);
const n = data.rows;
const at = (id) => document.getElementById(id);
const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;
const numbers = new Float64Array(bytes(data.numbers));
const codes = new Uint16Array(bytes(data.codes));
const column = Object.fromEntries(
  data.columns.map((one, k) => [one.name, { ...one, values: numbers.subarray(k * n, (k + 1) * n) }]));
const code = Object.fromEntries(
  ["log_id", "point", "state", "judged"].map((name, k) => [name, codes.subarray(k * n, (k + 1) * n)]));
const names = { log_id: data.logs, point: data.points };
const axes = data.columns.filter((one) => one.axis).map((one) => one.name);

// Codes and colours as in sample.py and card.css; those that come last are drawn on top.
const classes = {
  state: [[0, "left", "left out by balance"], [2, "held", "held out for validation"], [1, "curated", "curated"]],
  judged: [[0, "left", "not judged"], [1, "true", "error at most 0.75 of the spread of the advantage"],
    [2, "between", "0.75 to 3 of it"], [3, "false", "3 of it or more"]],
};

let rules = [];

// --- rules ---

const isRange = (value) => Array.isArray(value) && value.length === 2 && value.every(Number.isFinite) && value[0] <= value[1];
const isList = (value) => Array.isArray(value) && value.length > 0 && value.every((one) => typeof one === "string");

function cleaned(rule) {
  // Rules may come from the address of the page, so only what a rule can hold is taken.
  const kept = { kind: rule.kind === "include" ? "include" : "exclude" };
  for (const name of Object.keys(column)) if (isRange(rule[name])) kept[name] = rule[name];
  for (const name of Object.keys(names)) if (isList(rule[name])) kept[name] = rule[name];
  return Object.keys(kept).length > 1 ? kept : null;
}

function fitsRule(rule, row) {
  return Object.entries(rule).every(([name, value]) => {
    if (name === "kind") return true;
    if (name in names) return value.includes(names[name][code[name][row]]);
    const number = column[name].values[row];
    return number >= value[0] && number <= value[1];
  });
}

function usedRows() {
  const include = rules.filter((rule) => rule.kind === "include");
  const exclude = rules.filter((rule) => rule.kind === "exclude");
  return Array.from({ length: n }, (_, row) =>
    (!include.length || include.some((rule) => fitsRule(rule, row))) && !exclude.some((rule) => fitsRule(rule, row)));
}

// --- TOML ---

const tomlNumber = (value) => (Number.isInteger(value) && Math.abs(value) < 1e15 ? value.toFixed(1) : String(value));
const tomlText = (text) => JSON.stringify(text).replace(/\u007f/g, "\\u007f");

function tomlPairs(rule) {
  return Object.entries(rule).filter(([name]) => name !== "kind").map(([name, value]) =>
    `${name} = [${value.map(name in names ? tomlText : tomlNumber).join(", ")}]`);
}

function toml() {
  if (!rules.length) return "# No rules: every usable row is a candidate.\n";
  return rules.map((rule) => [`[[curate.${rule.kind}]]`, ...tomlPairs(rule), ""].join("\n")).join("\n");
}

// --- the ranges that are being chosen ---

function chosen() {
  const rule = {};
  for (const name of axes) {
    const [from, to] = [at(`${name}-from`), at(`${name}-to`)];
    if (from.value === "" && to.value === "") continue;
    // An end that is not given is that of all usable rows, which the sample need not reach.
    rule[name] = [from.value === "" ? Math.min(column[name].from, to.valueAsNumber) : from.valueAsNumber,
      to.value === "" ? Math.max(column[name].to, from.valueAsNumber) : to.valueAsNumber];
  }
  return rule;
}

function choose(name, low, high, span) {
  // As many digits as a pixel is worth.
  const digits = Math.min(15, Math.max(0, Math.ceil(-Math.log10(span / 1000))));
  at(`${name}-from`).value = String(Number(low.toFixed(digits)));
  at(`${name}-to`).value = String(Number(high.toFixed(digits)));
}

// --- the drawing ---

const canvas = at("scatter");
const margin = { left: 62, right: 12, top: 10, bottom: 40 };
let scales = null;
let pressed = null;
let zoom = {};

function scaleOf(name, from, to) {
  const one = column[name];
  let [low, high] = zoom[name] || [one.from, one.to];
  const pad = (high - low) * 0.02 || Math.abs(low) * 0.1 || 1;
  [low, high] = [low - pad, high + pad];
  return { name, low, high, from, to,
    place: (value) => from + ((value - low) / (high - low)) * (to - from),
    value: (place) => low + ((place - from) / (to - from)) * (high - low) };
}

function ticks(scale, apart) {
  const rough = ((scale.high - scale.low) * apart) / Math.abs(scale.to - scale.from);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((size) => size >= rough);
  const found = [];
  for (let k = Math.ceil(scale.low / step); k * step <= scale.high; k += 1) found.push(Number((k * step).toPrecision(12)));
  return found;
}

function drawAxes(pen, colours, width, height) {
  pen.font = "12px system-ui, sans-serif";
  pen.strokeStyle = colours("rule");
  pen.fillStyle = colours("soft");
  pen.textAlign = "center";
  for (const value of ticks(scales.x, 75)) {
    const x = scales.x.place(value);
    pen.strokeRect(x, margin.top, 0, height - margin.top - margin.bottom);
    pen.fillText(String(value).replace("-", "\u2212"), x, height - margin.bottom + 15);
  }
  pen.textAlign = "right";
  for (const value of ticks(scales.y, 45)) {
    const y = scales.y.place(value);
    pen.strokeRect(margin.left, y, width - margin.left - margin.right, 0);
    pen.fillText(String(value).replace("-", "\u2212"), margin.left - 6, y + 4);
  }
  pen.fillStyle = colours("ink");
  pen.textAlign = "center";
  pen.fillText(column[scales.x.name].label, (margin.left + width - margin.right) / 2, height - 6);
  pen.save();
  pen.translate(12, (margin.top + height - margin.bottom) / 2);
  pen.rotate(-Math.PI / 2);
  pen.fillText(column[scales.y.name].label, 0, 0);
  pen.restore();
}

function drawRows(pen, colours, used) {
  const by = at("colour").value;
  const [xs, ys] = [column[scales.x.name].values, column[scales.y.name].values];
  for (const [which, colour] of classes[by]) {
    pen.fillStyle = pen.strokeStyle = colours(colour);
    for (let row = 0; row < n; row += 1) {
      if (code[by][row] !== which) continue;
      const [x, y] = [scales.x.place(xs[row]), scales.y.place(ys[row])];
      pen.globalAlpha = used[row] ? 0.75 : 0.25;
      pen.beginPath();
      pen.arc(x, y, 2.2, 0, 7);
      if (used[row]) pen.fill(); else pen.stroke();
    }
  }
  pen.globalAlpha = 1;
}

function drawBox(pen, colours) {
  const rule = chosen();
  const [x, y] = [rule[scales.x.name], rule[scales.y.name]];
  if (!x && !y) return;
  const [left, right] = x ? x.map(scales.x.place) : [scales.x.from, scales.x.to];
  const [bottom, top] = y ? y.map(scales.y.place) : [scales.y.from, scales.y.to];
  pen.strokeStyle = pen.fillStyle = colours("box");
  pen.globalAlpha = 0.1;
  pen.fillRect(left, top, right - left, bottom - top);
  pen.globalAlpha = 1;
  pen.lineWidth = 1.5;
  pen.strokeRect(left, top, right - left, bottom - top);
}

function draw(used = usedRows()) {
  const style = getComputedStyle(document.documentElement);
  const colours = (name) => style.getPropertyValue(`--${name}`).trim();
  const { width, height } = canvas.getBoundingClientRect();
  if (!width) return;
  const ratio = window.devicePixelRatio || 1;
  [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  scales = { x: scaleOf(at("across").value, margin.left, width - margin.right),
    y: scaleOf(at("up").value, height - margin.bottom, margin.top) };
  drawAxes(pen, colours, width, height);
  pen.save();
  pen.beginPath();
  pen.rect(margin.left, margin.top, width - margin.left - margin.right, height - margin.top - margin.bottom);
  pen.clip();
  drawRows(pen, colours, used);
  drawBox(pen, colours);
  pen.restore();
}

// --- what the page says ---

const grouped = (value) => value.toLocaleString("en");

function tell(used) {
  const count = used.filter(Boolean).length;
  at("count").dataset.used = count;
  at("count").textContent = `${grouped(count)} of ${grouped(n)} rows of the sample are used` +
    (n < data.candidates ? `, about ${grouped(Math.round((count / n) * data.candidates))} of all ${grouped(data.candidates)}.` : ".");
  at("toml").textContent = toml();
  at("copied").textContent = "";
  const made = data.rules.map((rule) => JSON.stringify(cleaned(rule)));
  const now = rules.map((rule) => JSON.stringify(rule));
  at("gone").hidden = made.every((rule) => now.includes(rule));
  at("rules").replaceChildren(...rules.map((rule, k) => {
    const [item, text, words, button] = ["li", "span", "code", "button"].map((tag) => document.createElement(tag));
    words.textContent = tomlPairs(rule).join(", ");
    text.append(`${rule.kind} `, words);
    button.type = "button";
    button.textContent = "Remove";
    button.setAttribute("aria-label", `Remove rule ${k + 1}: ${rule.kind} ${words.textContent}`);
    button.onclick = () => { rules.splice(k, 1); keep(); };
    item.append(text, button);
    return item;
  }));
}

function tellRanges() {
  const rule = chosen();
  const good = Object.keys(rule).length > 0 && Object.values(rule).every(isRange);
  for (const id of ["include", "exclude", "zoom"]) at(id).disabled = !good;
  let inside = 0;
  if (good) for (let row = 0; row < n; row += 1) inside += fitsRule(rule, row);
  const wrong = Object.keys(rule).length > 0 && !good;
  at("inside").textContent = wrong ? "A range must go from the smaller number to the larger." :
    good ? `${grouped(inside)} rows of the sample lie inside.` : "";
  draw();
}

function tellKey() {
  at("key").replaceChildren("Filled: used; rings: not used.", ...classes[at("colour").value].flatMap(([which, colour, words]) => {
    const count = code[at("colour").value].reduce((sum, one) => sum + (one === which), 0);
    const dot = document.createElement("b");
    dot.style.background = `var(--${colour})`;
    const part = document.createElement("span");
    part.append(dot, `${words} (${grouped(count)})`);
    return count ? [part] : [];
  }));
}

function changed() {
  const used = usedRows();
  tell(used);
  draw(used);
}

function keep() {
  changed();
  // The address holds the rules, so that a selection can be sent or kept as a link.
  try {
    history.replaceState(null, "", `#rules=${encodeURIComponent(JSON.stringify(rules))}`);
  } catch { /* some viewers of files forbid it, and the page does without */ }
}

function begin() {
  let asked = null;
  try {
    asked = JSON.parse(decodeURIComponent(location.hash.replace(/^#rules=/, "")));
  } catch { /* the address asks for nothing that can be read */ }
  rules = (Array.isArray(asked) ? asked : data.rules).filter(Boolean).map(cleaned).filter(Boolean);
  changed();
}

// --- what people do ---

function add(kind) {
  const rule = cleaned({ kind, ...chosen() });
  if (rule) rules.push(rule);
  empty();
  keep();
}

function empty() {
  for (const name of axes) at(`${name}-from`).value = at(`${name}-to`).value = "";
  tellRanges();
}

canvas.onpointerdown = (event) => {
  pressed = [event.offsetX, event.offsetY];
  canvas.setPointerCapture(event.pointerId);
};
canvas.onpointermove = (event) => {
  if (!pressed) return;
  const { x, y } = scales;
  const clip = (place, scale) => scale.value(Math.min(Math.max(place, Math.min(scale.from, scale.to)), Math.max(scale.from, scale.to)));
  const across = [clip(pressed[0], x), clip(event.offsetX, x)].sort((a, b) => a - b);
  const up = [clip(pressed[1], y), clip(event.offsetY, y)].sort((a, b) => a - b);
  choose(x.name, ...across, x.high - x.low);
  if (x.name !== y.name) choose(y.name, ...up, y.high - y.low);
  requestAnimationFrame(tellRanges);
};
canvas.onpointerup = canvas.onpointercancel = () => { pressed = null; };

for (const id of ["across", "up", "colour"]) at(id).onchange = () => { tellKey(); draw(); };
for (const name of axes) at(`${name}-from`).oninput = at(`${name}-to`).oninput = tellRanges;
at("include").onclick = () => add("include");
at("exclude").onclick = () => add("exclude");
at("zoom").onclick = () => { zoom = { ...zoom, ...chosen() }; empty(); };
at("clear").onclick = () => { zoom = {}; empty(); };
at("copy").onclick = async () => {
  try {
    await navigator.clipboard.writeText(toml());
  } catch {
    at("toml").select();
    document.execCommand("copy");
  }
  at("copied").textContent = "Copied.";
};
window.onresize = () => draw();
window.onbeforeprint = () => { document.documentElement.classList.add("printing"); draw(); };
window.onafterprint = () => { document.documentElement.classList.remove("printing"); draw(); };
matchMedia("(prefers-color-scheme: dark)").onchange = () => draw();

window.onhashchange = begin;

tellKey();
tellRanges();
begin();
