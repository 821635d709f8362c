// Figures and tables of one frame, from what report.json says of it. Text is set as text, never as markup.
"use strict";

function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.includes("-") || key === "role") made.setAttribute(key, value);
    else made[key] = value;
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

// Four significant digits, or the number itself where it is whole.
function shown(value) {
  if (value === null || value === undefined) return "–";
  if (typeof value !== "number") return String(value);
  if (Number.isInteger(value)) return String(value);
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-4 ? value.toExponential(3) : String(Number(value.toPrecision(4)));
}

function panel(title, ...children) {
  return element("div", { className: "panel" }, element("h2", {}, title), ...children);
}

// Rows of cells; numbers stand at the right of their column.
function table(head, rows) {
  const cell = (tag) => (value) =>
    element(tag, { className: typeof value === "number" ? "number" : "" }, value instanceof Node ? value : shown(value));
  const row = (cells) => element("tr", { className: cells.strong ? "strong" : "" }, ...cells.map(cell("td")));
  const body = element("tbody", {}, ...rows.map(row));
  const heading = head ? element("thead", {}, element("tr", {}, ...head.map(cell("th")))) : null;
  return element("table", { className: head ? "" : "pairs" }, heading, body);
}

// An object as rows: name, value; inner objects with their names before theirs.
function entries(value, before = "") {
  return Object.entries(value).flatMap(([key, inner]) => {
    const name = before ? `${before} ${key.replaceAll("_", " ")}` : key.replaceAll("_", " ");
    if (Array.isArray(inner)) {
      if (inner.some(Array.isArray)) return [];
      return inner.length ? [[name, inner.map((v) => (v && typeof v === "object" ? JSON.stringify(v) : shown(v))).join(", ")]] : [];
    }
    return inner !== null && typeof inner === "object" ? entries(inner, name) : [[name, inner]];
  });
}

// Two digits of a standard error say all that it tells.
const withError = (mean) =>
  !mean ? "–" : mean.standard_error == null ? shown(mean.value) : `${shown(mean.value)} ± ${shown(Number(mean.standard_error.toPrecision(2)))}`;

function figurePanels(report) {
  const panels = [];
  const { rel_l2: error, estimate, loss } = report;
  if (error) {
    const of = (name, value) => [name, value, value / error.denoised];
    const rows = [of("noisy", error.noisy), of("denoised", error.denoised), of("corrected", error.corrected)];
    rows[2].strong = true;
    if (error.best_mix) rows.push(of(`best mix of noisy and denoised (${shown(error.best_mix.share)} noisy)`, error.best_mix.rel_l2));
    const note = error.reference_noise_removed ? "The reference's own noise is taken out." : "The reference's own noise is part of every figure.";
    panels.push(panel("relL2 against the reference", table(["", "relL2", "of the denoiser's"], rows), element("p", { className: "note" }, note)));
  }
  const { temporal } = report;
  if (temporal) {
    const rows = [["denoised", temporal.denoised, 1], ["corrected", temporal.picture, temporal.picture / temporal.denoised]];
    rows[1].strong = true;
    const note = `Over ${shown(Number((100 * temporal.share).toPrecision(3)))} % of the pixels: those that the frame before shows too.`;
    panels.push(panel("Flicker against the frame before", table(["", "temporal error", "of the denoiser's"], rows), element("p", { className: "note" }, note)));
  }
  const rows = [
    ["denoised", withError(estimate?.denoised), loss?.denoised],
    ["corrected", withError(estimate?.corrected), loss?.corrected],
    ["gain", withError(estimate?.gain), loss ? loss.denoised - loss.corrected : null],
  ];
  rows[1].strong = true;
  panels.push(
    panel(
      "Estimated from the frame itself",
      table(["", "relL2 of the halves' mean", "self-supervised loss"], rows),
      report.held_out_gain ? element("p", { className: "note" }, `Gain over pixels that training left out: ${withError(report.held_out_gain)} of loss.`) : null,
    ),
  );
  const roles = (report.roles ?? []).map((role) => [role.role, role.buffer, role.channels.join(", "), role.file]);
  panels.push(panel("Roles", table(["role", "samples", "channels", "file"], roles)));
  return panels;
}

function tablePanels(report) {
  const panels = [];
  const summary = [["mean share used", report.mean_share], ["strength asked for", report.strength]];
  for (const key of ["active_share", "model_loss", "steps", "planned_steps", "steps_dropped", "end", "milliseconds_per_step", "preset", "seed", "backend"]) {
    if (report[key] !== undefined) summary.push([key.replaceAll("_", " "), report[key]]);
  }
  const size = `${report.width} x ${report.height}`;
  for (const [name, value] of [["pixels", size], ["exposure of the method", report.exposure], ["instruction set", report.instruction_set], ["threads", report.threads], ["version", report.version]]) {
    if (value !== undefined) summary.push([name, value]);
  }
  if (report.peak_rss_bytes) summary.push(["most memory held", `${Math.round(report.peak_rss_bytes / 2 ** 20)} MiB`]);
  panels.push(panel("Run", table(null, summary)));
  if (report.seconds) panels.push(panel("Seconds", table(null, entries(report.seconds))));
  const skipped = (report.skipped ?? []).map(({ what, why }) => [what, why]);
  if (report.skipped) panels.push(panel("Skipped", skipped.length ? table(["what", "why"], skipped) : element("p", {}, "nothing")));
  if (report.features) panels.push(panel("Features that took part", table(null, entries(report.features))));
  for (const [key, title] of [["settings", "Settings"], ["model", "Model"], ["found", "Found in the frame"], ["independence", "The halves"]]) {
    if (report[key]) panels.push(panel(title, table(null, entries(report[key]))));
  }
  return panels;
}

function messagesOf(frame) {
  const { fallback, unlike, warnings = [] } = frame.report;
  const banner = (text, grave) => element("p", { className: grave ? "banner grave" : "banner" }, text);
  return [
    ...(fallback ? [banner(`The picture is the denoiser's: ${fallback}`, true)] : []),
    ...(unlike ? [banner(unlike, true)] : []),
    ...warnings.map((warning) => banner(warning, false)),
  ];
}
