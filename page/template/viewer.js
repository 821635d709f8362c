// The pictures of a frame: two layers on top of each other behind a slider, zoomed and moved in step.
"use strict";

const CLOSE = 2; // Scale from which on pixels are shown as squares.
const FITTED = 0.98; // Share of the view that a fitted picture takes.

class Viewer {
  constructor(legend) {
    this.legend = legend;
    this.slider = document.getElementById("slider");
    this.layers = [document.getElementById("first-layer"), document.getElementById("second-layer")];
    this.chosen = [0, 0];
    this.split = 50;
    this.stops = 0;
    this.pictures = [];
    this.fitted = true;
    const still = { noBind: true, animate: false, overflow: "visible", cursor: "grab", minScale: 0.01, maxScale: 64, step: 0.35 };
    this.panzoom = Panzoom(this.layers[0], still);
    this.layers[0].addEventListener("panzoomchange", () => this.follow());
    this.slider.addEventListener("pointerdown", (event) => {
      if (!event.target.closest(".grip")) this.panzoom.handleDown(event);
    });
    document.addEventListener("pointermove", (event) => this.panzoom.handleMove(event));
    for (const end of ["pointerup", "pointercancel"]) document.addEventListener(end, (event) => this.panzoom.handleUp(event));
    this.layers[0].addEventListener("panzoomstart", () => (this.fitted = false));
    this.slider.addEventListener(
      "wheel",
      (event) => {
        this.fitted = false;
        this.panzoom.zoomWithWheel(event);
      },
      { passive: false },
    );
    this.slider.addEventListener("slide", () => {
      this.split = this.slider.value;
      this.showLegend();
    });
    new ResizeObserver(() => this.fitted && this.fit()).observe(this.slider);
  }

  // Puts the pictures of a frame into both layers; what is chosen, zoom and place stay where they can.
  show(frame) {
    const before = this.pictures.map((picture) => picture.label);
    this.pictures = frame.pictures;
    const sameSize = this.width === frame.width && this.height === frame.height;
    [this.width, this.height] = [frame.width, frame.height];
    for (const layer of this.layers) {
      const holder = layer.parentElement;
      Object.assign(holder.style, { width: `${frame.width}px`, height: `${frame.height}px`, marginLeft: `${-frame.width / 2}px`, marginTop: `${-frame.height / 2}px` });
      layer.replaceChildren(...frame.pictures.map(({ label, scale, uri }) => element("img", { src: uri, alt: label, className: scale, draggable: false })));
    }
    const again = (index, usual) => {
      const found = this.pictures.findIndex((picture) => picture.label === (before[index] ?? usual));
      return found < 0 ? 0 : found;
    };
    this.chosen = before.length ? this.chosen.map((index) => again(index)) : [again(-1, "denoised"), again(-1, "corrected")];
    this.update();
    if (!sameSize || this.fitted) this.fit();
  }

  // Shows one picture over the whole view, in place.
  flip(index) {
    if (index >= this.pictures.length) return;
    this.chosen[0] = index;
    this.slider.value = 100;
    this.update();
  }

  // Chooses a side's picture and shows both.
  choose(side, index) {
    if (index >= this.pictures.length) return;
    this.chosen[side] = index;
    this.slider.value = this.split;
    this.update();
  }

  // Between one picture and two.
  toggleSplit() {
    this.slider.value = this.slider.value >= 100 ? this.split : 100;
    this.showLegend();
  }

  slide(by) {
    this.split = Math.min(Math.max(this.slider.value + by, 0), 100);
    this.slider.value = this.split;
    this.showLegend();
  }

  expose(stops) {
    this.stops = Math.min(Math.max(stops, -6), 6);
    const decode = (v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    const encode = (v) => (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
    const levels = Array.from({ length: 256 }, (_, i) => encode(Math.min(decode(i / 255) * 2 ** this.stops, 1)).toFixed(5));
    for (const channel of document.querySelectorAll("#exposure-filter feComponentTransfer > *")) channel.setAttribute("tableValues", levels.join(" "));
    for (const layer of this.layers) layer.classList.toggle("exposed", this.stops !== 0);
    document.getElementById("exposure").value = this.stops;
    document.getElementById("stops").textContent = `${this.stops > 0 ? "+" : ""}${this.stops} stops`;
  }

  fit() {
    const { clientWidth, clientHeight } = this.slider;
    this.zoomTo((FITTED * Math.min(clientWidth / this.width, clientHeight / this.height)) || 1);
    this.fitted = true;
  }

  // The middle of the picture in the middle of the view.
  zoomTo(scale) {
    this.fitted = false;
    this.panzoom.zoom(scale, { force: true });
    this.panzoom.pan(0, 0, { force: true });
    this.follow();
  }

  // The second layer lies as the first.
  follow() {
    const scale = this.panzoom.getScale();
    this.layers[1].style.transform = this.layers[0].style.transform;
    for (const layer of this.layers) layer.classList.toggle("close", scale >= CLOSE);
    document.getElementById("zoom").textContent = `${Math.round(100 * scale)} %`;
  }

  update() {
    this.layers.forEach((layer, side) => [...layer.children].forEach((image, index) => image.classList.toggle("shown", index === this.chosen[side])));
    for (const [side, id] of ["left", "right"].entries()) {
      const button = ({ label }, index) => {
        const made = element("button", { type: "button", role: "radio", "aria-checked": String(index === this.chosen[side]) }, element("kbd", {}, `${index + 1} `), label);
        made.addEventListener("click", () => this.choose(side, index));
        return made;
      };
      document.getElementById(id).replaceChildren(...this.pictures.map(button));
    }
    this.showLegend();
  }

  // What the colours of a map mean, where one is shown.
  showLegend() {
    const visible = this.slider.value >= 100 ? this.chosen.slice(0, 1) : this.chosen;
    const scale = visible.map((index) => this.pictures[index].scale).find((scale) => scale !== "radiance");
    document.getElementById("legend").hidden = !scale;
    if (!scale) return;
    const [low, high] = scale === "error" ? this.legend.error.map((v) => `relL2 ${shown(Number(v.toPrecision(3)))}`) : ["0 (denoiser)", `${shown(Number(this.legend.share.toPrecision(3)))} of the correction`];
    document.getElementById("legend-low").textContent = low;
    document.getElementById("legend-high").textContent = high;
    const canvas = document.getElementById("colours");
    const context = canvas.getContext("2d");
    const gradient = context.createLinearGradient(0, 0, canvas.width, 0);
    this.legend.colours.forEach((colour, i) => gradient.addColorStop(i / (this.legend.colours.length - 1), `rgb(${colour.join(",")})`));
    context.fillStyle = gradient;
    context.fillRect(0, 0, canvas.width, canvas.height);
  }
}
