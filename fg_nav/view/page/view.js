"use strict";
// Walks in progress. Messages come over a websocket (fg_nav/view/servers.py and board.py); `walks` is what they told, by
// the walkers' names ("" of a page of one), `walk` the one whose instruments are shown, and `view` how all are looked at.

const CHI_95 = Math.sqrt(-2 * Math.log(0.05)); // semi-axis of the 95 % ellipse, in sigmas: chi-square of two
const RETRY_MS = 1000, NOTICE_MS = 8000, MAX_REMARKS = 50, MAX_REASONS = 2, STALE_S = 3;
const STANDING_S = 3, MOTIONLESS_S = 30; // a standing that is told, and one that may be trouble
const MARGIN = 62, NARROW = 500; // pixels above and below the path, for what lies on the map; widths of phones
const NEAREST = 2000, FARTHEST = 0.002; // pixels a metre

/** What is known of a walk: feet, of two sensors, by side path and last; start, m on the map; heardAt, null for never. */
const newWalk = (name) => ({ name, path: [], last: null, status: null, distance: 0, feet: {}, remarks: [], start: [0, 0], heardAt: null, address: "" });
const walks = new Map([["", newWalk("")]]);
let walk = walks.get("");
const plan = { image: null, light: null, dark: null, origin: [0, 0], right: [1, 0], down: [0, -1] }; // m of a pixel
const view = { east: 0, north: 0, scale: 40, mode: "all", courseUp: false, turn: 0 }; // mode: all, follow or free
const link = { lost: false };

const $ = (id) => document.getElementById(id);
const canvas = $("canvas"), pen = canvas.getContext("2d"), dark = matchMedia("(prefers-color-scheme: dark)");

// --- messages

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  const socket = new WebSocket(`${scheme}://${location.host}/live`);
  socket.onmessage = (message) => { take(JSON.parse(message.data)); };
  socket.onclose = () => { link.lost = true; show(); setTimeout(connect, RETRY_MS); };
}

function take(event) {
  link.lost = false;
  if (event.kind === "plan") takePlan(event);
  else takeOf(findWalk(event.walker ?? ""), event);
  show();
}

/** The walk of a name; the first one with a name takes the place of that without. */
function findWalk(name) {
  if (!walks.has(name)) {
    walks.delete("");
    walks.set(name, newWalk(name));
    if (!walks.has(walk.name)) walk = walks.get(name);
  }
  return walks.get(name);
}

function takeOf(one, event) {
  one.heardAt = performance.now();
  const say = (words) => notify(one.name ? `${one.name}: ${words[0].toLowerCase()}${words.slice(1)}` : words);
  if (event.kind === "walker") {
    Object.assign(one, { address: event.address, start: event.start_m, heardAt: event.heard_s === null ? null : one.heardAt - 1000 * event.heard_s });
  }
  if (event.kind === "history") {
    const { path, last, status, distance_m: distance, feet = {} } = event;
    Object.assign(one, { path, last, status, distance, feet, remarks: event.remarks.map(({ words }) => words).reverse() });
  }
  if (event.kind === "now") event.foot && event.foot !== one.last?.foot ? takeFoot(one, event) : takeNow(one, event);
  if (event.kind === "status") { one.status = event; one.distance = event.distance_m; }
  if (event.kind === "remark") one.remarks = [event.words, ...one.remarks].slice(0, MAX_REMARKS);
  if (event.kind === "foot") say(`The ${event.foot} foot is ${event.state}: ${event.reason}.`);
  if (event.kind === "turned" && event.foot === one.last?.foot) say(`The map was turned by ${Math.abs(event.angle_deg).toFixed(1)}° ${event.angle_deg < 0 ? "counterclockwise" : "clockwise"}.`);
  if (event.kind === "retracted") say("A false footfall was taken back.");
}

function takeNow(one, event) {
  one.last = event;
  one.path.push([event.t, ...event.position_m]);
}

/** A line of a foot next to the path of the page; before there is one, of the left foot, it begins that. */
function takeFoot(one, event) {
  if (one.last === null) takeNow(one, event);
  const foot = one.feet[event.foot];
  if (!foot || event.frame !== one.last.frame) return;
  foot.last = event;
  foot.path.push([event.t, ...event.position_m]);
}

function takePlan(event) {
  Object.assign(plan, { origin: event.origin_m, right: event.right_m, down: event.down_m });
  plan.image ??= Object.assign(new Image(), { src: "plan", onload() {
    for (const [scheme, filter] of [["light", "none"], ["dark", "invert(1) hue-rotate(180deg)"]]) {
      plan[scheme] = new OffscreenCanvas(this.naturalWidth, this.naturalHeight);
      Object.assign(plan[scheme].getContext("2d"), { filter }).drawImage(this, 0, 0);
    }
    show();
  } });
}

let noticeTimer = 0;
function notify(words) {
  $("notice").textContent = words;
  $("notice").hidden = false;
  clearTimeout(noticeTimer);
  noticeTimer = setTimeout(() => { $("notice").hidden = true; }, NOTICE_MS);
}

// --- what is known

const known = (key, one = walk) => one.status?.[key] ?? one.last?.[key] ?? null;
const position = (one = walk) => known("position_m", one) ?? one.path.at(-1)?.slice(1) ?? null;

/** Covariance of east and north, m^2: ee, en, nn. */
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
function course(one = walk) {
  const here = one.path.at(-1);
  for (let k = one.path.length - 2; k >= 0; k--) {
    const [east, north] = [here[1] - one.path[k][1], here[2] - one.path[k][2]];
    if (Math.hypot(east, north) > 0.4) return Math.atan2(east, north);
  }
  return null;
}

const hasEnded = (one) => one.status?.source === "ended";

/** For how long nothing was heard of a walk, s: its source as its status says, and since that came; 0 where all is well. */
function silence(one) {
  const source = one.status?.source ?? "", unheard = one.heardAt === null ? 0 : (performance.now() - one.heardAt) / 1000;
  const told = source.startsWith("silent") ? parseFloat(source.slice(7)) : 0;
  return hasEnded(one) || (!told && unheard < STALE_S) ? 0 : told + unheard;
}

const lasting = (seconds) => seconds < 120 ? `${Math.floor(seconds)} s` : `${Math.floor(seconds / 60)} min`;

/** What a walker does, in words and how badly; the words alone are no news of one who walks. */
function stateOf(one) {
  const { standing, standing_s: stood = 0, speed_m_s: speed } = one.status ?? {}, silent = silence(one);
  if (hasEnded(one)) return ["", "ended"];
  if (one.heardAt === null) return ["bad", `no contact with ${one.address}`];
  if (silent) return ["bad", `silent for ${lasting(silent)}`];
  if (standing && stood >= STANDING_S) return [stood >= MOTIONLESS_S ? "caution" : "", `standing for ${lasting(stood)}`];
  if (!one.last) return ["", "not walking yet"];
  return ["good", speed ? `walking, ${speed.toFixed(1)} m/s` : "walking"];
}

// --- instruments

function put(id, value, digits = 0, unit = "", sign = false) {
  const there = Number.isFinite(value) && value !== null;
  const element = $(id);
  element.textContent = there ? (sign && value > 0 ? "+" : "") + value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "−") : "–";
  if (there && unit) element.append(Object.assign(document.createElement("b"), { textContent: unit }));
}

function putSigma(id, value, digits, unit) {
  $(id).textContent = Number.isFinite(value) && value !== null ? `± ${value.toFixed(value >= 10 ? 0 : value >= 1 ? 1 : digits)} ${unit}` : "";
}

function putLamp(id, kind, words) {
  $(id).className = `lamp ${kind}`;
  $(id).querySelector("span").textContent = words;
}

function showFigures() {
  const at = position(), sigma = known("position_sigma_m") ?? [], status = walk.status ?? {};
  put("east", at?.[0], sigma[0] >= 1 ? 1 : 2); put("north-m", at?.[1], sigma[1] >= 1 ? 1 : 2, "m");
  putSigma("east-sigma", sigma[0], 2, ""); putSigma("north-sigma", sigma[1], 2, "");
  const heading = known("heading_deg");
  put("heading", heading === null ? null : Math.round(heading) % 360, 0, "°"); putSigma("heading-sigma", known("heading_sigma_deg"), 1, "°");
  put("floor", known("floor"), 0, "", true); $("floor-words").textContent = known("floor") === null ? "not known" : "from the start";
  showReturns(status.returns ?? []);
  put("height", at?.[2], 2, "m"); putSigma("height-sigma", sigma[2], 2, "m");
  put("speed", status.speed_m_s, 1, "m/s"); put("distance", walk.distance, walk.distance < 1000 && !(sigma[0] >= 1) ? 1 : 0, "m");
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
const lines = (one = walk) => one.last?.foot === "person" ? Object.values(one.feet).map((foot) => foot.last) : one.last ? [one.last] : [];

/** The line with the worst verdict on the path. */
const judge = (one = walk) => lines(one).sort((a, b) => WORDS.indexOf(b.verdict) - WORDS.indexOf(a.verdict))[0];

/** Whether the path up to the newest line is to be trusted, and the heaviest reasons why not. */
function showTrust() {
  const judged = judge();
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
  const standing = walk.status?.standing, stood = walk.status?.standing_s >= STANDING_S ? `Standing for ${lasting(walk.status.standing_s)}` : "Stands";
  putLamp("stance", standing ? "good" : "", standing == null ? "No stance yet" : standing ? stood : "Swings");
  const newest = lines().sort((a, b) => b.t - a.t)[0] ?? {}, field = newest.field;
  putLamp("field", field === "quasi-static" ? "good" : field === "disturbed" ? "caution" : "",
    { "quasi-static": "Field undisturbed", disturbed: "Field disturbed" }[field] ?? "Field not judged");
  $("field-reason").textContent = newest.field_reason ?? "";
}

/** What is wrong, in words and how badly; null where nothing is. */
function trouble() {
  const all = [...walks.values()];
  if (all.every(hasEnded)) return ["calm", all.length > 1 ? "All walks have ended." : "The walk has ended."];
  if (link.lost) return ["", "Connection lost: this is how it was. Trying again."];
  const quiet = all.filter((one) => one.name && stateOf(one)[0] === "bad").map((one) => `${one.name}: ${stateOf(one)[1]}`);
  if (walk.name) return quiet.length ? ["", `${quiet.join("; ")}.`] : null;
  if (walk.status?.source?.startsWith("silent")) return ["", `The source is ${stateOf(walk)[1]}.`];
  return silence(walk) ? ["caution", "The navigator is busy: no news."] : null;
}

/** The walkers of a page of several; a click shows the instruments of one. */
function showWalkers() {
  const named = [...walks.values()].filter((one) => one.name), list = $("walkers");
  list.hidden = !named.length;
  while (list.children.length < named.length) {
    const item = document.createElement("li"), button = item.appendChild(document.createElement("button"));
    for (const part of ["dot", "who", "mark", "state"]) button.appendChild(document.createElement("span")).className = part;
    button.addEventListener("click", () => { walk = walks.get(button.dataset.name); show(); });
    list.append(item);
  }
  named.forEach((one, k) => {
    const button = list.children[k].firstChild, [dot, who, mark, state] = button.children, [kind, words] = stateOf(one);
    const [trust] = TRUST[judge(one)?.verdict] ?? [""], floor = known("floor", one);
    button.dataset.name = who.textContent = one.name;
    button.setAttribute("aria-pressed", String(one === walk));
    dot.style.background = `var(--walker-${1 + (k % WALKERS)})`;
    [mark.className, mark.textContent] = [`mark ${trust}`, { good: "✓", caution: "~", bad: "×" }[trust] ?? ""];
    mark.title = TRUST[judge(one)?.verdict]?.[1] ?? "Path not judged yet";
    state.className = `state ${kind}`;
    state.textContent = [words, one.last && `${one.distance.toFixed(0)} m`, floor !== null && `floor ${floor > 0 ? "+" : ""}${floor}`].filter(Boolean).join(" · ");
  });
}

function showRemarks() {
  if (showRemarks.shown === walk.remarks) return;
  showRemarks.shown = walk.remarks;
  $("remarks").replaceChildren(...walk.remarks.map((words) => Object.assign(document.createElement("li"), { textContent: words })));
}

function showState() {
  const source = walk.status?.source ?? "", wrong = trouble();
  $("banner").hidden = wrong === null;
  if (wrong) [$("banner").className, $("banner").textContent] = wrong;
  const quiet = silence(walk) ? `silent for ${lasting(silence(walk))}` : "";
  $("source").textContent = link.lost ? "not connected" : quiet || ({ ok: "source sends", ended: "ended", "": "waiting" }[source] ?? source);
  $("source").className = `state ${link.lost || quiet ? "bad" : source === "ok" ? "good" : ""}`;
  document.body.classList.toggle("lost", link.lost && !hasEnded(walk));
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
  const bounds = [Infinity, Infinity, -Infinity, -Infinity];
  const include = (east, north) => {
    bounds[0] = Math.min(bounds[0], east); bounds[1] = Math.min(bounds[1], north);
    bounds[2] = Math.max(bounds[2], east); bounds[3] = Math.max(bounds[3], north);
  };
  for (const one of walks.values()) {
    const cov = covarianceOf(one.last), at = position(one) ?? [0, 0], [e0, n0] = one.start;
    const rows = [[0, 0, 0], ...one.path, [0, ...at]];
    if (cov) for (const side of [-1, 1]) { // room for the ellipse, unless it is larger than the path
      const most = 0.3 * Math.max(10, Math.hypot(at[0], at[1]));
      rows.push([0, ...[cov[0], cov[2]].map((square, k) => at[k] + side * Math.min(CHI_95 * Math.sqrt(square), most))]);
    }
    for (const [, east, north] of rows) include(e0 + east, n0 + north);
  }
  for (const corner of planCorners()) include(...corner);
  view.east = (bounds[0] + bounds[2]) / 2;
  view.north = (bounds[1] + bounds[3]) / 2;
  const [wide, high] = [Math.max(bounds[2] - bounds[0], 6), Math.max(bounds[3] - bounds[1], 6)];
  const reach = view.courseUp ? [Math.hypot(wide, high), Math.hypot(wide, high)] : [wide, high];
  const below = size.width < NARROW ? 1.6 * MARGIN : MARGIN; // there the scale is above the tools
  view.scale = clampScale(Math.min((size.width - 80) / reach[0], (size.height - MARGIN - below) / reach[1]));
  const lower = unproject(0, (below - MARGIN) / 2);
  view.east += lower[0];
  view.north += lower[1];
}

const clampScale = (scale) => Math.min(NEAREST, Math.max(FARTHEST, scale));

function draw() {
  const color = colors();
  pen.fillStyle = color.ground;
  pen.fillRect(0, 0, size.width, size.height);
  const at = position(), way = course();
  view.turn = view.courseUp && way !== null ? way : 0;
  if (view.mode === "all") fitAll();
  if (view.mode === "follow" && at) [view.east, view.north] = [at[0] + walk.start[0], at[1] + walk.start[1]];
  if (!drawPlan()) drawGrid(color);
  drawFeet(color);
  const all = [...walks.values()], shades = all.map((one, k) => one.name ? color[`walker-${1 + (k % WALKERS)}`] : color.path);
  all.forEach((one, k) => drawPath(color, shades[k], one));
  labels.length = 0;
  all.forEach((one, k) => { if (position(one)) { drawEllipse(one.name ? shades[k] : color.ellipse, one); drawPerson(color, one.name ? shades[k] : color.ink, one); } });
  drawScale();
  $("needle").setAttribute("transform", `rotate(${(-view.turn * 180) / Math.PI})`);
}

const WALKERS = 6; // colours of walkers
const colors = () => {
  const style = getComputedStyle(document.documentElement);
  return new Proxy({}, { get: (_, name) => style.getPropertyValue(`--${name}`).trim() });
};

const place = (one, east, north) => project(east + one.start[0], north + one.start[1]);

/** Corners of the plan, m, once it is loaded. */
function planCorners() {
  const { light, origin, right, down } = plan;
  return light ? [[0, 0], [1, 0], [0, 1], [1, 1]].map(([x, y]) => [0, 1].map((k) => origin[k] + x * light.width * right[k] + y * light.height * down[k])) : [];
}

function drawPlan() {
  const [from, right, down] = planCorners().map((corner) => project(...corner)), sheet = dark.matches ? plan.dark : plan.light;
  if (!from) return false;
  pen.save();
  pen.transform((right[0] - from[0]) / sheet.width, (right[1] - from[1]) / sheet.width, (down[0] - from[0]) / sheet.height, (down[1] - from[1]) / sheet.height, ...from);
  pen.globalAlpha = 0.6;
  pen.globalCompositeOperation = dark.matches ? "screen" : "multiply"; // its paper is the ground
  pen.drawImage(sheet, 0, 0);
  pen.restore();
  return true;
}

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

function drawPath(color, shade, one) {
  const points = one.path.map(([, east, north]) => place(one, east, north));
  const at = position(one);
  if (!points.length) return;
  drawReturns(color, points, one);
  pen.lineJoin = pen.lineCap = "round";
  pen.strokeStyle = shade;
  pen.lineWidth = one.name && one === walk ? 3.25 : 2.25;
  pen.beginPath(); pen.moveTo(...points[0]);
  for (const point of points) pen.lineTo(...point);
  if (at) pen.lineTo(...place(one, at[0], at[1]));
  pen.stroke();
  if (view.scale > 12) {
    pen.fillStyle = shade;
    for (const [x, y] of points.slice(-400)) { pen.beginPath(); pen.arc(x, y, 3, 0, 2 * Math.PI); pen.fill(); }
  }
  pen.strokeStyle = color.ink; pen.fillStyle = color.ground; pen.lineWidth = 2;
  pen.beginPath(); pen.arc(...points[0], 5, 0, 2 * Math.PI); pen.fill(); pen.stroke();
  pen.fillStyle = color.soft; pen.font = "12px system-ui, sans-serif";
  if (!one.name) pen.fillText("start", points[0][0] + 10, points[0][1] + 4);
}

/** Of two sensors each foot's path, in its own colour, and the ellipse of its newest footfall. */
function drawFeet(color) {
  for (const [side, foot] of Object.entries(walk.feet)) {
    if (side === walk.last?.foot) continue; // it is the path of the page
    const points = foot.path.map(([, east, north]) => place(walk, east, north));
    if (!points.length) continue;
    pen.strokeStyle = pen.fillStyle = color[side];
    pen.lineWidth = 1.25;
    pen.beginPath(); pen.moveTo(...points[0]);
    for (const point of points) pen.lineTo(...point);
    pen.stroke();
    if (view.scale > 12) for (const [x, y] of points.slice(-400)) { pen.beginPath(); pen.arc(x, y, 2.5, 0, 2 * Math.PI); pen.fill(); }
    drawRing(color[side], walk, foot.path.at(-1).slice(1), covarianceOf(foot.last), 0.05);
  }
  $("feet").hidden = Object.keys(walk.feet).length < 2;
}

/** A wide line along what was recognized as walked before. */
function drawReturns(color, points, one) {
  pen.strokeStyle = color.again; pen.lineWidth = 11; pen.globalAlpha = 0.35;
  for (const [begin, end] of one.status?.returns ?? []) {
    pen.beginPath();
    one.path.forEach(([t], k) => { if (t >= begin && t <= end) pen.lineTo(...points[k]); });
    pen.stroke();
  }
  pen.globalAlpha = 1;
}

function drawEllipse(shade, one) {
  const cov = covarianceOf(one.last), at = position(one);
  if (!cov) return;
  const [a, b, angle] = ellipse(cov);
  if (one === walk) canvas.dataset.ellipse = JSON.stringify({ east: at[0], north: at[1], a, b, angle });
  drawRing(shade, one, at, cov, 0.16);
}

function drawRing(color, one, at, cov, filled) {
  if (!cov) return;
  const [a, b, angle] = ellipse(cov), [x, y] = place(one, at[0], at[1]);
  pen.beginPath();
  pen.ellipse(x, y, Math.min(a * view.scale, 1e5), Math.min(b * view.scale, 1e5), -angle - view.turn, 0, 2 * Math.PI);
  pen.fillStyle = color; pen.globalAlpha = filled; pen.fill();
  pen.strokeStyle = color; pen.globalAlpha = 0.9; pen.lineWidth = 1.25; pen.stroke();
  pen.globalAlpha = 1;
}

const labels = []; // drawn so far: left, right and baseline; the next one moves below those in its place

/** The arrow, with the name of one of several, and what is to be known of who does not walk. */
function drawPerson(color, shade, one) {
  const [x, y] = place(one, ...position(one)), way = course(one), [kind, words] = stateOf(one);
  pen.font = "600 13px system-ui, sans-serif"; pen.lineJoin = "round"; pen.lineWidth = 4;
  pen.strokeStyle = color.ground; pen.fillStyle = color[["bad", "caution"].includes(kind) ? kind : "ink"];
  const label = [one.name, kind === "good" || (one.name && hasEnded(one)) ? "" : words].filter(Boolean).join(": ");
  const wide = pen.measureText(label).width, left = x + 14 + wide > size.width; // on the other side where it would be cut off
  const from = left ? x - 14 - wide : x + 14, isTaken = ([a, b, c]) => a < from + wide && from < b && Math.abs(c - low) < 16;
  let low = y + 5;
  for (let k = 0; label && k < labels.length && labels.some(isTaken); k++) low = Math.max(...labels.filter(isTaken).map(([, , c]) => c)) + 16;
  if (label) labels.push([from, from + wide, low]);
  canvas.dataset.labels = JSON.stringify(labels);
  pen.textAlign = "left";
  pen.strokeText(label, from, low); pen.fillText(label, from, low);
  pen.save();
  pen.translate(x, y);
  pen.fillStyle = shade; pen.strokeStyle = color.ground; pen.lineWidth = 2;
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
    showFigures(); showTrust(); showLamps(); showLosses(); showRemarks(); showState(); showWalkers(); draw();
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
dark.addEventListener("change", show);
setInterval(show, 1000); // silence is news too
resize();
connect();
