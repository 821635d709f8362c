// Curves: the loss over training, and the error over the frames of a shot (uPlot).
"use strict";

const INK = "#101010";
const COLOURS = { noisy: "#7a1a00", denoised: "#10307a", corrected: "#0d4a26", thin: "#5c5c5c" };

// One significant digit or two, as a label of an axis should be: not the end of its range.
const isRound = (value) => Math.abs(value - Number(value.toPrecision(2))) <= 1e-9 * Math.abs(value);

function chart(title, note, x, series, options = {}) {
  const holder = element("div", {});
  const axis = { stroke: INK, grid: { stroke: "#8a8a8a", width: 1 }, ticks: { stroke: "#6a6a6a" } };
  const size = { width: options.width ?? 560, height: 260 };
  new uPlot(
    {
      ...size,
      scales: { x: { time: false }, y: options.linear ? {} : { distr: 3, range: (_, low, high) => [low / 1.1, high * 1.1] } },
      axes: [{ ...axis, ...options.x }, { ...axis, size: 74, values: (_, ticks) => ticks.map((v) => (v === null || !isRound(v) ? "" : shown(v))) }],
      series: [{ label: options.label ?? "step", value: (_, v) => shown(v) }, ...series.map(({ label, colour, width, points }) => ({ label, stroke: colour, width: width ?? 2, points: { show: points ?? false }, value: (_, v) => shown(v) }))],
    },
    [x, ...series.map((s) => s.values)],
    holder,
  );
  return panel(title, holder, note ? element("p", { className: "note" }, note) : null);
}

// Mean over the last `window` values.
function runningMean(values, window) {
  let sum = 0;
  return values.map((value, i) => {
    sum += value - (i >= window ? values[i - window] : 0);
    return sum / Math.min(i + 1, window);
  });
}

function trainingCurves({ losses, rates, frames }) {
  if (!losses.length) return [];
  const steps = losses.map((_, i) => i + 1);
  // A logarithmic axis has no place for what is not positive.
  const positive = (values) => values.map((value) => (value > 0 ? value : null));
  const window = Math.max(frames.length, Math.ceil(losses.length / 20));
  const finite = losses.map((loss) => loss ?? 0);
  const several = frames.length > 1 ? ", of the frames in turn" : "";
  return [
    chart(`Loss of each step's tiles${several}`, `Dark: its mean over the last ${window} steps. Convergence is where that curve is level.`, steps, [
      { label: "loss", colour: COLOURS.thin, width: 1, values: positive(losses) },
      { label: "mean", colour: INK, values: positive(runningMean(finite, window)) },
    ]),
    chart("Learning rate", "", steps, [{ label: "rate", colour: INK, values: rates }], { linear: true }),
  ];
}

function shotCurves({ frames }) {
  if (frames.length < 2) return [];
  const x = frames.map((_, i) => i + 1);
  const pick = (path) => frames.map((frame) => path(frame.report) ?? null).map((value) => (value > 0 ? value : null));
  const line = (label, values) => ({ label, colour: COLOURS[label], values, points: true });
  const measured = [
    line("noisy", pick((r) => r.rel_l2?.noisy)),
    line("denoised", pick((r) => r.rel_l2?.denoised)),
    line("corrected", pick((r) => r.rel_l2?.corrected)),
  ];
  const flicker = [
    line("denoised", pick((r) => r.temporal?.denoised)),
    line("corrected", pick((r) => r.temporal?.picture)),
  ];
  const estimated = [
    line("denoised", pick((r) => r.estimate?.denoised?.value)),
    line("corrected", pick((r) => r.estimate?.corrected?.value)),
  ];
  const places = { label: "frame", width: 760, x: { incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000] } };
  const some = (series) => series.some((s) => s.values.some((v) => v !== null));
  return [
    ...(some(measured) ? [chart("relL2 of the frames, in their order", "", x, measured, places)] : []),
    ...(some(flicker) ? [chart("Flicker", "Error of the change from the frame before, along the motion of the references.", x, flicker, places)] : []),
    ...(some(estimated) ? [chart("Estimated relL2 of the halves' mean", "", x, estimated, places)] : []),
  ];
}
