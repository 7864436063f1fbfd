"use strict";
// Draws the charts of the page. All data stand in it; nothing is asked of a network.

const charts = JSON.parse(document.getElementById("charts").textContent);
const onTouch = matchMedia("(pointer: coarse)").matches;
const PAPER_WIDTH = 700; // pixels, of A4 less its margins
const NARROW = 760; // widths of phones, as in the style

const CONFIG = {
  responsive: true,
  displaylogo: false,
  displayModeBar: onTouch ? true : "hover",
  doubleClick: "reset",
  modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
};

function layoutOf(chart) {
  const axes = Object.fromEntries(Object.entries(chart.layout).map(([name, value]) =>
    [name, /^[xy]axis/.test(name) ? { gridcolor: "#d9dee3", linecolor: "#5a636c", ticks: "outside", ticklen: 4, tickcolor: "#8a9096", ...value } : value]));
  return {
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { family: "system-ui, -apple-system, Segoe UI, Roboto, sans-serif", size: 12, color: "#1d2125" },
    margin: { l: 52, r: 12, t: 8, b: innerWidth > NARROW ? 42 : 70 }, // on a phone the toolbar is below, off the legend
    legend: { orientation: "h", x: 0, y: 1.01, xanchor: "left", yanchor: "bottom", font: { size: 12 } },
    hoverlabel: { font: { size: 12, color: "#ffffff" }, bgcolor: "#2b3138", bordercolor: "#2b3138", align: "left", namelength: -1 },
    hovermode: "x",
    dragmode: onTouch ? false : "zoom",
    ...axes,
  };
}

// A round length that takes at most a quarter of the map.
function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return power * Math.max(...[1, 2, 5].filter((step) => step * power <= most));
}

// The scale bar and the north arrow, which follow the zoom: bar and arrow have their size in pixels.
function markScale(element, north) {
  const axis = element._fullLayout.xaxis;
  const perMeter = axis._length / Math.abs(axis.range[1] - axis.range[0]);
  const meters = roundLength(axis._length / 4 / perMeter);
  const key = `${meters} ${Math.round(meters * perMeter)} ${Math.round(axis._length)}`;
  if (!Number.isFinite(perMeter) || element.dataset.scale === key) return;
  element.dataset.scale = key;
  const bar = (x0, y0, x1, y1) => ({
    type: "line", xref: "paper", yref: "paper", xsizemode: "pixel", ysizemode: "pixel", xanchor: 0, yanchor: 0,
    x0, y0, x1, y1, line: { color: "#1d2125", width: 2 },
  });
  const [left, low, right] = [12, 14, 12 + meters * perMeter];
  const words = meters >= 1000 ? `${meters / 1000} km` : meters >= 1 ? `${meters} m` : `${Math.round(meters * 100)} cm`;
  const mark = { xref: "paper", yref: "paper", showarrow: false, font: { size: 12 } };
  Plotly.relayout(element, {
    shapes: [bar(left, low, right, low), bar(left, low - 4, left, low + 4), bar(right, low - 4, right, low + 4)],
    annotations: [
      { ...mark, x: 0, y: 0, xanchor: "center", yanchor: "bottom", xshift: (left + right) / 2, yshift: low + 1, text: words },
      { xref: "paper", yref: "paper", x: 1, y: 1, xshift: -22, yshift: -14, ax: 0, ay: 34, axref: "pixel", ayref: "pixel",
        text: north, showarrow: true, arrowhead: 2, arrowwidth: 2, arrowcolor: "#1d2125", font: { size: 12 }, name: "north" },
    ],
  });
}

function draw(name, chart) {
  const element = document.getElementById(`chart-${name}`);
  return Plotly.newPlot(element, chart.data, layoutOf(chart), CONFIG).then(() => {
    if (!chart.scaled) return;
    markScale(element, chart.north);
    element.on("plotly_afterplot", () => markScale(element, chart.north));
  });
}

// On paper every chart is as wide as the sheet, and the parameters are unfolded.
function fitTo(width) {
  for (const name of Object.keys(charts)) {
    Plotly.relayout(`chart-${name}`, width ? { width, autosize: false } : { width: undefined, autosize: true });
  }
}

Promise.all(Object.entries(charts).map(([name, chart]) => draw(name, chart))).then(() => {
  document.documentElement.dataset.drawn = "yes";
  matchMedia("print").addEventListener("change", (print) => fitTo(print.matches ? PAPER_WIDTH : 0));
  if (matchMedia("print").matches) fitTo(PAPER_WIDTH);
});
