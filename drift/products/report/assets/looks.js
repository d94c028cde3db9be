"use strict";
// How shapes are drawn: kinds differ in dashes or symbol, not only in colour.
const INKS = {
  light: { area: "#0b4f8a", search: "#003b36", contact: "#a30052", track: "#111111", datum: "#8a5a00", ashore: "#7a1fa2", start: "#c62828", way: "#1b5e20",
    lane: "#1f4e8c", plan: "#7a3b00", grey: "#55606b", current: "#00629b", wind: "#4a4a4a", halo: "#ffffff", ink: "#1b2733" },
  dark: { area: "#8ec7ff", search: "#7fe0d3", contact: "#ff8ac4", track: "#f2f2f2", datum: "#ffd166", ashore: "#d59bf0", start: "#ff8a80", way: "#9fdc9f",
    lane: "#9dbbe8", plan: "#ffc27a", grey: "#a9b4bf", current: "#6cc5ff", wind: "#d6d6d6", halo: "#10151a", ink: "#e8edf2" },
};

// ink: a name in INKS. width [px], dash [px], fill: share of the ink inside, symbol: of a point, size [px].
const LOOKS = {
  area: { ink: "area", width: 2.2 },
  coast: { ink: "area", width: 7 },
  searched: { ink: "search", width: 1.8, fill: 0.06, symbol: "plus", size: 6 },
  legs: { ink: "search", width: 1 },
  transit: { ink: "search", width: 1, dash: [1, 4] },
  field: { ink: "search", width: 1.5, dash: [6, 3] },
  barrier: { ink: "search", width: 3.2, dash: [3, 2] },
  line: { ink: "grey", width: 1.8, dash: [9, 3, 2, 3] },
  contact: { ink: "contact", width: 1.5, dash: [7, 2, 2, 2], fill: 0.05, symbol: "diamond", size: 6 },
  planned: { ink: "plan", width: 2.2, fill: 0.08 },
  planned_legs: { ink: "plan", width: 1.1 },
  planned_transit: { ink: "plan", width: 1, dash: [1, 4] },
  planned_point: { ink: "plan", width: 1.6, symbol: "circle", size: 5 },
  start: { ink: "start", width: 2, dash: [6, 2, 1, 2], symbol: "cross", size: 8 },
  way: { ink: "way", width: 1.6, dash: [10, 3], symbol: "square", size: 4 },
  lane: { ink: "lane", width: 0.8 },
  mean: { ink: "track", width: 1.6, symbol: "circle", size: 6 },
  datum: { ink: "datum", width: 1.4, dash: [4, 3], symbol: "plus", size: 8 },
  buoy: { ink: "datum", width: 1.8, dash: [10, 3], symbol: "diamond", size: 5 },
  report: { ink: "datum", width: 1.8, symbol: "square", size: 5 },
  ashore: { ink: "ashore", width: 0.5, fill: 0.8, symbol: "dot", size: 3 },
  sample: { ink: "grey", width: 0.5, fill: 0.9, symbol: "dot", size: 2.4 },
  stretch: { ink: "ashore", width: 5 },
  patrol: { ink: "plan", width: 9 },
  find: { ink: "contact", width: 2, symbol: "circle", size: 6 },
  current: { ink: "current", width: 1.6, symbol: "arrow" },
  wind: { ink: "wind", width: 1.3, dash: [5, 2], symbol: "arrow" },
  domain: { ink: "grey", width: 1.8, dash: [1, 4] },
  covers_wind: { ink: "wind", width: 1.4, dash: [4, 4] },
  covers_current: { ink: "current", width: 1.8, dash: [12, 5] },
  place: { ink: "ink", width: 1, symbol: "dot", size: 2.5 },
};
const DASHES = [[], [8, 3], [8, 3, 2, 3], [12, 4], [5, 2, 2, 2, 2, 2]]; // of areas, from the innermost; the outermost is dotted
// Magma (Smith and van der Walt 2015), from light to dark: even steps to the eye and in grey print.
const SHADES = ["#fcf0b2", "#fed799", "#febe83", "#fea570", "#fc8a62", "#f66f5c", "#e9575d", "#d3436e", "#b83779", "#9c2e7f", "#802582", "#641a80", "#491078"];

function rgb(text) {
  return [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16));
}

function tinted(text, share) {
  return `rgba(${rgb(text).join(",")},${share})`;
}

const FULL_COLOUR = 235, PALE = 80; // opacity of the shading, of 255; pale where most is ashore and the coast comes first

// 256 colours of shading, as ABGR of a little-endian canvas; on a dark page the densest cells are the lightest.
function shading(theme, opacity) {
  const colours = new Uint32Array(256), list = theme === "dark" ? [...SHADES].reverse() : SHADES;
  for (let k = 0; k < 256; k++) {
    const at = (k / 255) * (list.length - 1), i = Math.min(list.length - 2, Math.floor(at)), share = at - i;
    const [a, b] = [rgb(list[i]), rgb(list[i + 1])];
    const [red, green, blue] = a.map((value, j) => Math.round(value + share * (b[j] - value)));
    colours[k] = ((opacity << 24) | (blue << 16) | (green << 8) | red) >>> 0;
  }
  return colours;
}

function symbol(kind, size, stroke, fill) {
  const shared = { stroke, fill, declutterMode: "none" }; // a symbol always stays, and does not hide its own name
  if (kind === "circle") return new ol.style.Circle({ radius: size, stroke, declutterMode: "none" });
  if (kind === "dot") return new ol.style.Circle({ radius: size, fill, declutterMode: "none" });
  if (kind === "plus" || kind === "cross")
    return new ol.style.RegularShape({ points: 4, radius: size, radius2: 0, angle: kind === "cross" ? Math.PI / 4 : 0, ...shared });
  return new ol.style.RegularShape({ points: 4, radius: size, angle: kind === "square" ? Math.PI / 4 : 0, ...shared });
}

// A band whose middle goes from the ink (share 0) to the halo (1), so that thin lines under it stay visible.
function banded(look, theme, share) {
  const made = LOOKS[look], inks = INKS[theme], [ink, halo] = [inks[made.ink], inks.halo].map(rgb);
  const middle = `rgb(${ink.map((value, k) => Math.round(value + share * (halo[k] - value))).join(",")})`;
  return [[made.width + 2, inks.halo], [made.width, inks[made.ink]], [made.width - 2, middle]]
    .map(([width, color]) => new ol.style.Style({ stroke: new ol.style.Stroke({ color, width }) }));
}

// The styles of a shape. now: {theme, strong: drawn bolder, pale: drawn lighter, dash, width, colour, size: of its symbol, as a share,
// opaque: how much a dot is, as a share}.
function styled(look, now) {
  const made = LOOKS[look], inks = INKS[now.theme], ink = now.colour || inks[made.ink];
  const colour = tinted(ink, now.pale ? 0.55 : 1), width = (now.width || made.width) * (now.strong ? 1.8 : 1);
  const stroke = new ol.style.Stroke({ color: colour, width, lineDash: now.dash || made.dash || null });
  const halo = new ol.style.Stroke({ color: tinted(inks.halo, 0.7), width: width + 2 });
  const fill = new ol.style.Fill({ color: tinted(ink, made.fill || 0) });
  const solid = new ol.style.Fill({ color: made.symbol === "dot" ? tinted(ink, (made.fill || 1) * (now.opaque || 1)) : inks.halo });
  const image = made.symbol && made.symbol !== "arrow"
    ? symbol(made.symbol, made.size * (now.size || 1), new ol.style.Stroke({ color: colour, width: Math.min(width, 2.4) }), solid) : undefined;
  const lines = feature => feature.get("outline") || feature.getGeometry();
  const styles = [new ol.style.Style({ stroke: halo, geometry: lines }), new ol.style.Style({ stroke, image, geometry: lines })];
  if (made.fill && made.symbol !== "dot") styles.push(new ol.style.Style({ fill }));
  return styles;
}

// The style of a shape's name. now: {theme, label, along: written along the longest outlines, colour}.
function titled(look, now) {
  const inks = INKS[now.theme], ink = now.colour || inks[LOOKS[look].ink];
  if (!now.label) return [];
  return [new ol.style.Style({ text: lettered(now.label, ink, inks.halo, now.along), geometry: now.along ? longest : feature => nameplate(feature.getGeometry()) })];
}

// The outlines that carry a shape's name: the longest, and those at least half as long.
function longest(feature) {
  const lines = feature.get("outline")?.getLineStrings();
  if (!lines?.length) return feature.getGeometry();
  const most = Math.max(...lines.map(line => line.getLength()));
  return new ol.geom.MultiLineString(lines.filter(line => line.getLength() >= most / 2));
}

// The position of a shape's name: one, however many parts it has.
function nameplate(geometry) {
  const kind = geometry.getType();
  if (kind === "Point") return geometry;
  if (kind === "MultiPolygon") return new ol.geom.Point(geometry.getPolygon(0).getInteriorPoint().getCoordinates());
  if (kind === "Polygon") return new ol.geom.Point(geometry.getInteriorPoint().getCoordinates());
  const line = kind === "LineString" ? geometry : geometry.getLineString(0);
  return new ol.geom.Point(line.getCoordinateAt(0.5));
}

function lettered(text, colour, halo, along) {
  return new ol.style.Text({
    text, font: "600 12px system-ui, sans-serif", fill: new ol.style.Fill({ color: colour }), stroke: new ol.style.Stroke({ color: halo, width: 3 }),
    placement: along ? "line" : "point", offsetY: along ? 0 : -13, overflow: true, maxAngle: 0.6,
  });
}

// The symbol of a look in the list of layers.
function swatch(canvas, look, theme) {
  const made = LOOKS[look], context = canvas.getContext("2d"), ink = INKS[theme][made.ink];
  const [wide, high] = [canvas.width, canvas.height];
  context.clearRect(0, 0, wide, high);
  context.strokeStyle = context.fillStyle = ink;
  context.lineWidth = 2 * Math.min(made.width, 5);
  context.setLineDash((made.dash || []).map(length => 2 * length));
  context.beginPath();
  if (made.symbol === "dot" || (made.symbol && !made.dash && !made.fill && made.symbol !== "arrow")) {
    context.arc(wide / 2, high / 2, 2 * (made.size || 3), 0, 2 * Math.PI);
    if (made.symbol === "dot") context.fill();
  } else {
    context.moveTo(4, high / 2);
    context.lineTo(wide - 4, high / 2);
    if (made.symbol === "arrow") {
      context.lineTo(wide - 14, high / 2 - 8);
      context.moveTo(wide - 4, high / 2);
      context.lineTo(wide - 14, high / 2 + 8);
    }
  }
  context.stroke();
}
