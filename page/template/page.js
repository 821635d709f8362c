// The page: its data, the viewer, the keys.
"use strict";

const data = JSON.parse(document.getElementById("data").textContent);
const viewer = new Viewer(data.legend);
let current = 0;

// A frame's errors, measured before estimated.
function errorsOf({ report }) {
  const { rel_l2: error, estimate } = report;
  if (error) return { denoised: error.denoised, corrected: error.corrected };
  return { denoised: estimate?.denoised?.value, corrected: estimate?.corrected?.value };
}

function showFrame(index) {
  current = Math.min(Math.max(index, 0), data.frames.length - 1);
  const frame = data.frames[current];
  viewer.show(frame);
  document.getElementById("stored").textContent = `pictures stored as ${frame.stored}`;
  const failed = data.failed.map(({ name, message }) => element("p", { className: "banner grave" }, `${name} was not corrected: ${message}`));
  document.getElementById("messages").replaceChildren(...failed, ...messagesOf(frame));
  document.getElementById("figures").replaceChildren(...figurePanels(frame.report));
  document.getElementById("tables").replaceChildren(...tablePanels(frame.report));
  [...document.getElementById("strip").children].forEach((button, i) => button.setAttribute("aria-current", String(i === current)));
}

// The error of the change from the frame before, where it was measured.
function flickerOf({ report: { temporal } }) {
  if (!temporal) return null;
  const { picture, denoised } = temporal;
  const ratio = denoised > 0 ? `, ${shown(Number((picture / denoised).toPrecision(2)))} of the denoiser's` : "";
  return element("div", { className: "flicker" }, `flicker ${shown(picture)}${ratio}`);
}

function fillStrip() {
  const strip = document.getElementById("strip");
  const several = data.frames.length > 1;
  strip.hidden = document.getElementById("frame-keys").hidden = !several;
  if (!several) return;
  strip.append(
    ...data.frames.map((frame, index) => {
      const { denoised, corrected } = errorsOf(frame);
      const ratio = corrected / denoised;
      const level = element("i", { className: ratio > 1 ? "worse" : "" });
      level.style.width = `${Math.min(Math.max(100 * ratio, 0), 100) || 0}%`;
      const button = element(
        "button",
        { type: "button", title: `${frame.name}: corrected ${shown(corrected)}, denoised ${shown(denoised)}` },
        element("img", { src: frame.thumbnail, alt: "" }),
        element("div", {}, frame.name),
        element("div", {}, `relL2 ${frame.report.rel_l2 ? "" : "about "}${shown(corrected)}, ${shown(Number(ratio.toPrecision(2)))} of the denoiser's`),
        flickerOf(frame),
        element("div", { className: "level" }, level),
      );
      button.addEventListener("click", () => showFrame(index));
      return button;
    }),
  );
}

function onKey(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.target.matches?.("input")) return;
  const digit = /^(?:Digit|Numpad)([0-9])$/.exec(event.code)?.[1];
  const actions = {
    " ": () => viewer.toggleSplit(),
    ArrowLeft: () => viewer.slide(-1),
    ArrowRight: () => viewer.slide(1),
    z: () => viewer.zoomTo(1),
    "+": () => viewer.expose(viewer.stops + 0.5),
    "=": () => viewer.expose(viewer.stops + 0.5),
    "-": () => viewer.expose(viewer.stops - 0.5),
    ",": () => showFrame(current - 1),
    ".": () => showFrame(current + 1),
  };
  const action = digit === "0" ? () => viewer.fit() : digit ? () => (event.shiftKey ? viewer.choose(1, digit - 1) : viewer.flip(digit - 1)) : actions[event.key];
  if (!action) return;
  event.preventDefault();
  action();
}

document.getElementById("tool").textContent = data.tool;
document.getElementById("exposure").addEventListener("input", (event) => viewer.expose(Number(event.target.value)));
document.getElementById("fit").addEventListener("click", () => viewer.fit());
document.getElementById("actual").addEventListener("click", () => viewer.zoomTo(1));
document.addEventListener("keydown", onKey);
fillStrip();
viewer.expose(0);
showFrame(0);
document.getElementById("curves").append(...shotCurves(data), ...trainingCurves(data));
