"use strict";
// A walk in progress. Messages come over a websocket (fg_nav/view/page_server.py says which); `walk` is what they told,
// and `view` how it is looked at. All that is drawn follows from these two.

const CHI_95 = Math.sqrt(-2 * Math.log(0.05)); // semi-axis of the 95 % ellipse, in sigmas: chi-square of two
const RETRY_MS = 1000, NOTICE_MS = 8000, MAX_REMARKS = 50, MAX_REASONS = 2, STALE_MS = 3000;
const MARGIN = 62; // pixels above and below the path: what lies on the map
const NEAREST = 2000, FARTHEST = 0.002; // pixels a metre

const walk = { path: [], last: null, status: null, distance: 0, feet: {} }; // feet: of two sensors, path and last by side
const view = { east: 0, north: 0, scale: 40, mode: "all", courseUp: false, turn: 0 }; // mode: all, follow or free
const link = { socket: null, lost: false, heardAt: 0, ended: false };

const $ = (id) => document.getElementById(id);
const canvas = $("canvas"), pen = canvas.getContext("2d");

// --- messages

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/live`);
  link.socket = socket;
  socket.onmessage = (message) => { take(JSON.parse(message.data)); };
  socket.onclose = () => { link.lost = true; show(); setTimeout(connect, RETRY_MS); };
}

function take(event) {
  link.lost = false;
  link.heardAt = performance.now();
  if (event.kind === "history") takeHistory(event);
  if (event.kind === "now") event.foot && event.foot !== walk.last?.foot ? takeFoot(event) : takeNow(event);
  if (event.kind === "status") { walk.status = event; walk.distance = event.distance_m; }
  if (event.kind === "remark") addRemark(event);
  if (event.kind === "foot") notify(`The ${event.foot} foot is ${event.state}: ${event.reason}.`);
  if (event.kind === "turned" && event.foot === walk.last?.foot) notify(`The map was turned by ${Math.abs(event.angle_deg).toFixed(1)}° ${event.angle_deg < 0 ? "counterclockwise" : "clockwise"}.`);
  if (event.kind === "retracted") notify("A false footfall was taken back.");
  show();
}

function takeHistory(event) {
  Object.assign(walk, { path: event.path, last: event.last, status: event.status, distance: event.distance_m, feet: event.feet ?? {} });
  $("remarks").replaceChildren();
  event.remarks.forEach(addRemark);
}

function takeNow(event) {
  const before = walk.path.at(-1) ?? [0, ...event.position_m];
  walk.last = event;
  walk.distance += Math.hypot(event.position_m[0] - before[1], event.position_m[1] - before[2]);
  walk.path.push([event.t, ...event.position_m]);
}

/** A line of a foot next to the path of the page; before there is one, of the left foot, it begins that. */
function takeFoot(event) {
  if (walk.last === null) takeNow(event);
  const foot = walk.feet[event.foot];
  if (!foot || event.frame !== walk.last.frame) return;
  foot.last = event;
  foot.path.push([event.t, ...event.position_m]);
}

function addRemark(event) {
  const item = document.createElement("li");
  item.textContent = event.words;
  $("remarks").prepend(item);
  while ($("remarks").children.length > MAX_REMARKS) $("remarks").lastChild.remove();
}

let noticeTimer = 0;
function notify(words) {
  $("notice").textContent = words;
  $("notice").hidden = false;
  clearTimeout(noticeTimer);
  noticeTimer = setTimeout(() => { $("notice").hidden = true; }, NOTICE_MS);
}

// --- what is known

const known = (key) => walk.status?.[key] ?? walk.last?.[key] ?? null;
const position = () => known("position_m") ?? walk.path.at(-1)?.slice(1) ?? null;

/** Covariance of east and north, m^2: ee, en, nn. */
const covariance = () => covarianceOf(walk.last);
function covarianceOf(line) {
  const sigma = line?.position_sigma_m;
  return sigma && [sigma[0] ** 2, line.east_north_cov_m2, sigma[1] ** 2];
}

/** Semi-axes (m) of the 95 % ellipse and the direction of the longer, counterclockwise from east. */
function ellipse([ee, en, nn]) {
  const middle = (ee + nn) / 2, apart = Math.hypot((ee - nn) / 2, en);
  return [CHI_95 * Math.sqrt(middle + apart), CHI_95 * Math.sqrt(Math.max(middle - apart, 0)), Math.atan2(2 * en, ee - nn) / 2];
}

/** Where the person walks to: rad clockwise from north, over the last stride of some length. */
function course() {
  const here = walk.path.at(-1);
  for (let k = walk.path.length - 2; k >= 0; k--) {
    const [east, north] = [here[1] - walk.path[k][1], here[2] - walk.path[k][2]];
    if (Math.hypot(east, north) > 0.4) return Math.atan2(east, north);
  }
  return null;
}

// --- instruments

function put(id, value, digits = 0, unit = "", sign = false) {
  const there = Number.isFinite(value) && value !== null;
  const element = $(id);
  element.textContent = there ? (sign && value > 0 ? "+" : "") + value.toFixed(digits).replace("-", "−") : "–";
  if (there && unit) element.append(Object.assign(document.createElement("b"), { textContent: unit }));
}

function putSigma(id, value, digits, unit) {
  $(id).textContent = Number.isFinite(value) && value !== null ? `± ${value.toFixed(value >= 10 ? 0 : digits)} ${unit}` : "";
}

function putLamp(id, kind, words) {
  $(id).className = `lamp ${kind}`;
  $(id).querySelector("span").textContent = words;
}

function showFigures() {
  const at = position(), sigma = known("position_sigma_m") ?? [], status = walk.status ?? {};
  put("east", at?.[0], 2); put("north-m", at?.[1], 2, "m");
  putSigma("east-sigma", sigma[0], 2, ""); putSigma("north-sigma", sigma[1], 2, "");
  put("heading", known("heading_deg"), 0, "°"); putSigma("heading-sigma", known("heading_sigma_deg"), 1, "°");
  put("floor", known("floor"), 0, "", true); $("floor-words").textContent = known("floor") === null ? "not known" : "from the start";
  showReturns(status.returns ?? []);
  put("height", at?.[2], 2, "m"); putSigma("height-sigma", sigma[2], 2, "m");
  put("speed", status.speed_m_s, 1, "m/s"); put("distance", walk.distance, walk.distance < 1000 ? 1 : 0, "m");
  put("range", at && Math.hypot(at[0], at[1]), 1, "m");
  put("latency", status.latency_ms, 0, "ms"); put("rate", status.rate_hz, 0, "Hz");
  $("time").textContent = clock(known("t") - (walk.path[0]?.[0] ?? 0), walk.path.length);
}

/** How many stretches of the walk were recognized as walked before. */
function showReturns(returns) {
  put("returns", walk.status?.returns && returns.length);
  const longest = Math.max(0, ...returns.map(([begin, end]) => end - begin));
  $("returns-words").textContent = returns.length ? `recognized by the field, longest ${clock(longest, true)}` : "";
}

function clock(seconds, there) {
  if (!there || !Number.isFinite(seconds)) return "–";
  const [h, m, s] = [seconds / 3600, (seconds / 60) % 60, seconds % 60].map((x) => String(Math.floor(x)).padStart(2, "0"));
  return `${h === "00" ? "" : h + ":"}${m}:${s}`;
}

const TRUST = {
  trusted: ["good", "Path trusted"], doubtful: ["caution", "Path doubtful"], "not to be used": ["bad", "Path not to be used"],
};

const WORDS = Object.keys(TRUST);

/** The newest line, or those of both feet: a person's has neither field nor verdict. */
const lines = () => walk.last?.foot === "person" ? Object.values(walk.feet).map((foot) => foot.last) : walk.last ? [walk.last] : [];

/** Whether the path up to the newest line is to be trusted, and the heaviest reasons why not. */
function showTrust() {
  const judged = lines().sort((a, b) => WORDS.indexOf(b.verdict) - WORDS.indexOf(a.verdict))[0];
  putLamp("trust", ...(TRUST[judged?.verdict] ?? ["", "Path not judged yet"]));
  const reasons = judged?.reasons ?? [], more = reasons.length - MAX_REASONS;
  const words = reasons.slice(0, MAX_REASONS).join("; ");
  $("trust-reason").textContent = words && `${words[0].toUpperCase()}${words.slice(1)}${more > 0 ? `; and ${more} more` : ""}.`;
  $("trust-reason").hidden = !words;
}

function showLosses() {
  const status = walk.status ?? {}, count = (number, name) => `${number} ${name}${number === 1 ? "" : "s"}`;
  const lost = [["sample", status.lost_samples], ["datagram", status.lost_datagrams]].filter(([, number]) => number > 0);
  $("losses").textContent = `Lost so far: ${lost.map(([name, number]) => count(number, name)).join(", ")}.`;
  $("losses").hidden = lost.length === 0;
}

function showLamps() {
  const standing = walk.status?.standing;
  putLamp("stance", standing ? "good" : "", standing == null ? "No stance yet" : standing ? "Stands" : "Swings");
  const newest = lines().sort((a, b) => b.t - a.t)[0] ?? {}, field = newest.field;
  putLamp("field", field === "quasi-static" ? "good" : field === "disturbed" ? "caution" : "",
    { "quasi-static": "Field undisturbed", disturbed: "Field disturbed" }[field] ?? "Field not judged");
  $("field-reason").textContent = newest.field_reason ?? "";
}

/** What is wrong, in words and how badly; null where nothing is. */
function trouble() {
  const source = walk.status?.source ?? "";
  if (link.ended) return ["calm", "The walk has ended."];
  if (link.lost) return ["", "Connection lost: this is how it was. Trying again."];
  if (source.startsWith("silent")) return ["", `The source is ${source.replace("silent", "silent for")}.`];
  if (link.heardAt && performance.now() - link.heardAt > STALE_MS) return ["caution", "The navigator is busy: no news."];
  return null;
}

function showState() {
  const source = walk.status?.source ?? "";
  link.ended = source === "ended";
  const wrong = trouble();
  $("banner").hidden = wrong === null;
  if (wrong) [$("banner").className, $("banner").textContent] = wrong;
  $("source").textContent = link.lost ? "not connected" : { ok: "source sends", ended: "ended", "": "waiting" }[source] ?? source;
  $("source").className = `state ${link.lost || source.startsWith("silent") ? "bad" : source === "ok" ? "good" : ""}`;
  document.body.classList.toggle("lost", link.lost && !link.ended);
  $("no-remarks").hidden = $("remarks").children.length > 0;
}

// --- map

/** Put the metres of the map at pixels: the middle of the view, turned, scaled. */
function project(east, north) {
  const [x, y] = [east - view.east, north - view.north], c = Math.cos(view.turn), s = Math.sin(view.turn);
  return [size.width / 2 + view.scale * (c * x - s * y), size.height / 2 - view.scale * (s * x + c * y)];
}

function unproject(dx, dy) {
  const [x, y] = [dx / view.scale, -dy / view.scale], c = Math.cos(view.turn), s = Math.sin(view.turn);
  return [c * x + s * y, c * y - s * x];
}

const size = { width: 0, height: 0 };
function resize() {
  const ratio = devicePixelRatio || 1;
  Object.assign(size, { width: canvas.clientWidth, height: canvas.clientHeight });
  canvas.width = Math.round(size.width * ratio);
  canvas.height = Math.round(size.height * ratio);
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  show();
}

function fitAll() {
  const rows = [...(walk.path.length ? walk.path : [[0, 0, 0, 0]]), [0, ...(position() ?? [0, 0, 0])]];
  const bounds = [Infinity, Infinity, -Infinity, -Infinity], cov = covariance(), at = rows.at(-1);
  if (cov) for (const side of [-1, 1]) { // room for the ellipse, unless it is larger than the path
    const most = 0.3 * Math.max(10, Math.hypot(at[1], at[2])) * side;
    const [east, north] = [cov[0], cov[2]].map((square) => CHI_95 * Math.sqrt(square) * side);
    rows.push([0, at[1] + (side * east < side * most ? east : most), at[2] + (side * north < side * most ? north : most)]);
  }
  for (const [, east, north] of rows) {
    bounds[0] = Math.min(bounds[0], east); bounds[1] = Math.min(bounds[1], north);
    bounds[2] = Math.max(bounds[2], east); bounds[3] = Math.max(bounds[3], north);
  }
  view.east = (bounds[0] + bounds[2]) / 2;
  view.north = (bounds[1] + bounds[3]) / 2;
  const [wide, high] = [Math.max(bounds[2] - bounds[0], 6), Math.max(bounds[3] - bounds[1], 6)];
  const reach = view.courseUp ? [Math.hypot(wide, high), Math.hypot(wide, high)] : [wide, high];
  view.scale = clampScale(Math.min((size.width - 80) / reach[0], (size.height - 2 * MARGIN) / reach[1]));
}

const clampScale = (scale) => Math.min(NEAREST, Math.max(FARTHEST, scale));

function draw() {
  const color = colors();
  pen.fillStyle = color.ground;
  pen.fillRect(0, 0, size.width, size.height);
  const at = position(), way = course();
  view.turn = view.courseUp && way !== null ? way : 0;
  if (view.mode === "all") fitAll();
  if (view.mode === "follow" && at) [view.east, view.north] = at;
  drawGrid(color);
  drawFeet(color);
  drawPath(color);
  if (at) { drawEllipse(color, at); drawPerson(color, at, way); }
  drawScale();
  $("needle").setAttribute("transform", `rotate(${(-view.turn * 180) / Math.PI})`);
}

const colors = () => {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(["ground", "grid", "grid-strong", "path", "past", "ellipse", "again", "left", "right", "ink", "soft"].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
};

/** 1, 2 or 5 times a power of ten, at least so long. */
function round(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [1, 2, 5, 10].map((x) => x * power).find((x) => x >= metres * 0.999);
}

function drawGrid(color) {
  const step = round(56 / view.scale), reach = Math.hypot(size.width, size.height) / view.scale / 2 + step;
  for (const [axis, middle] of [[0, view.east], [1, view.north]]) {
    for (let k = Math.ceil((middle - reach) / step); k * step < middle + reach; k++) {
      const ends = [-reach, reach].map((r) => axis ? project(view.east + r, k * step) : project(k * step, view.north + r));
      pen.strokeStyle = k % 5 ? color.grid : color["grid-strong"];
      pen.lineWidth = 1;
      pen.beginPath(); pen.moveTo(...ends[0]); pen.lineTo(...ends[1]); pen.stroke();
    }
  }
}

function drawPath(color) {
  const points = walk.path.map(([, east, north]) => project(east, north));
  const at = position();
  if (!points.length) return;
  drawReturns(color, points);
  pen.lineJoin = pen.lineCap = "round";
  pen.strokeStyle = color.path;
  pen.lineWidth = 2.25;
  pen.beginPath(); pen.moveTo(...points[0]);
  for (const point of points) pen.lineTo(...point);
  if (at) pen.lineTo(...project(at[0], at[1]));
  pen.stroke();
  if (view.scale > 12) {
    pen.fillStyle = color.path;
    for (const [x, y] of points.slice(-400)) { pen.beginPath(); pen.arc(x, y, 3, 0, 2 * Math.PI); pen.fill(); }
  }
  pen.strokeStyle = color.ink; pen.fillStyle = color.ground; pen.lineWidth = 2;
  pen.beginPath(); pen.arc(...points[0], 5, 0, 2 * Math.PI); pen.fill(); pen.stroke();
  pen.fillStyle = color.soft; pen.font = "12px system-ui, sans-serif";
  pen.fillText("start", points[0][0] + 10, points[0][1] + 4);
}

/** Of two sensors each foot's path, in its own colour, and the ellipse of its newest footfall. */
function drawFeet(color) {
  for (const [side, foot] of Object.entries(walk.feet)) {
    if (side === walk.last?.foot) continue; // it is the path of the page
    const points = foot.path.map(([, east, north]) => project(east, north));
    if (!points.length) continue;
    pen.strokeStyle = pen.fillStyle = color[side];
    pen.lineWidth = 1.25;
    pen.beginPath(); pen.moveTo(...points[0]);
    for (const point of points) pen.lineTo(...point);
    pen.stroke();
    if (view.scale > 12) for (const [x, y] of points.slice(-400)) { pen.beginPath(); pen.arc(x, y, 2.5, 0, 2 * Math.PI); pen.fill(); }
    drawRing(color[side], foot.path.at(-1).slice(1), covarianceOf(foot.last), 0.05);
  }
  $("feet").hidden = Object.keys(walk.feet).length < 2;
}

/** A wide line along what was recognized as walked before. */
function drawReturns(color, points) {
  pen.strokeStyle = color.again; pen.lineWidth = 11; pen.globalAlpha = 0.35;
  for (const [begin, end] of walk.status?.returns ?? []) {
    pen.beginPath();
    walk.path.forEach(([t], k) => { if (t >= begin && t <= end) pen.lineTo(...points[k]); });
    pen.stroke();
  }
  pen.globalAlpha = 1;
}

function drawEllipse(color, at) {
  const cov = covariance();
  if (!cov) return;
  const [a, b, angle] = ellipse(cov);
  canvas.dataset.ellipse = JSON.stringify({ east: at[0], north: at[1], a, b, angle });
  drawRing(color.ellipse, at, cov, 0.16);
}

function drawRing(color, at, cov, filled) {
  if (!cov) return;
  const [a, b, angle] = ellipse(cov), [x, y] = project(at[0], at[1]);
  pen.beginPath();
  pen.ellipse(x, y, Math.min(a * view.scale, 1e5), Math.min(b * view.scale, 1e5), -angle - view.turn, 0, 2 * Math.PI);
  pen.fillStyle = color; pen.globalAlpha = filled; pen.fill();
  pen.strokeStyle = color; pen.globalAlpha = 0.9; pen.lineWidth = 1.25; pen.stroke();
  pen.globalAlpha = 1;
}

function drawPerson(color, at, way) {
  const [x, y] = project(at[0], at[1]);
  pen.save();
  pen.translate(x, y);
  pen.fillStyle = color.ink; pen.strokeStyle = color.ground; pen.lineWidth = 2;
  pen.beginPath();
  if (way === null) pen.arc(0, 0, 6, 0, 2 * Math.PI);
  else { pen.rotate(way - view.turn); pen.moveTo(0, -11); pen.lineTo(7.5, 8); pen.lineTo(0, 4); pen.lineTo(-7.5, 8); pen.closePath(); }
  pen.stroke(); pen.fill();
  pen.restore();
}

function drawScale() {
  const metres = round(70 / view.scale);
  $("scale-words").textContent = metres >= 1000 ? `${metres / 1000} km` : metres >= 1 ? `${metres} m` : `${+(metres * 100).toPrecision(2)} cm`;
  $("scale-bar").style.width = `${metres * view.scale}px`;
}

// --- drawn once a frame, whatever came

let asked = false;
function show() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    showFigures(); showTrust(); showLamps(); showLosses(); showState(); draw();
    Object.assign(canvas.dataset, { points: walk.path.length, scale: view.scale, state: link.lost ? "lost" : "connected" });
  });
}

// --- hands

function zoom(factor, x = size.width / 2, y = size.height / 2) {
  if (view.mode === "all") setMode("free");
  const before = unproject(x - size.width / 2, y - size.height / 2);
  view.scale = clampScale(view.scale * factor);
  const after = unproject(x - size.width / 2, y - size.height / 2);
  view.east += before[0] - after[0];
  view.north += before[1] - after[1];
  show();
}

function setMode(mode) {
  view.mode = mode;
  $("fit").setAttribute("aria-pressed", String(mode === "all"));
  $("follow").setAttribute("aria-pressed", String(mode === "follow"));
  show();
}

function turnMap() {
  view.courseUp = !view.courseUp;
  $("up").textContent = view.courseUp ? "Course up" : "North up";
  show();
}

const pointers = new Map();
canvas.addEventListener("pointerdown", (event) => {
  canvas.setPointerCapture(event.pointerId);
  pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
});
canvas.addEventListener("pointermove", (event) => {
  const before = pointers.get(event.pointerId);
  if (!before) return;
  const here = [event.offsetX, event.offsetY], other = [...pointers].find(([id]) => id !== event.pointerId)?.[1];
  pointers.set(event.pointerId, here);
  if (other) {
    const [was, is] = [before, here].map((p) => Math.hypot(p[0] - other[0], p[1] - other[1]));
    if (was > 10) zoom(is / was, (here[0] + other[0]) / 2, (here[1] + other[1]) / 2);
    return;
  }
  const moved = unproject(here[0] - before[0], here[1] - before[1]);
  view.east -= moved[0];
  view.north -= moved[1];
  setMode("free");
});
for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => { pointers.delete(event.pointerId); });
canvas.addEventListener("wheel", (event) => {
  event.preventDefault();
  zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
}, { passive: false });

const actions = {
  "zoom-in": () => zoom(1.5), "zoom-out": () => zoom(1 / 1.5),
  fit: () => setMode("all"), follow: () => setMode(view.mode === "follow" ? "free" : "follow"), up: turnMap,
};
for (const [id, act] of Object.entries(actions)) $(id).addEventListener("click", act);
const keys = { "+": "zoom-in", "=": "zoom-in", "-": "zoom-out", a: "fit", f: "follow", u: "up" };
addEventListener("keydown", (event) => { if (!event.ctrlKey && !event.metaKey && keys[event.key]) actions[keys[event.key]](); });

new ResizeObserver(resize).observe(canvas);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
setInterval(show, 1000); // silence is news too
resize();
connect();
