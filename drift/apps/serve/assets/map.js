// The map: the shoreline, what the case says of the place, and the areas of a first map or a result. It goes round the Earth
// without a seam: OpenLayers repeats the world, and shapes beyond 180 degrees are drawn on both sides.
import { all, ask, get, guarded } from "./kit.js";

const target = get("map");
export const map = projected({ kind: "mercator", lon: 0, lat: 0, around: true });
const source = () => new ol.source.Vector({ wrapX: true });
/** @param {VectorSource} from @param {number} zIndex @param {StyleLike} [style] @param {boolean} [declutter] */
const layer = (from, zIndex, style, declutter = false) => new ol.layer.Vector({ source: from, zIndex, style, declutter, updateWhileAnimating: true });
/** @returns {Theme} */
const theme = () => (document.documentElement.dataset.theme === "dark" ? "dark" : "light");
/** @param {string} name */
const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export const land = source();
const given = source();
const particles = source();
const likely = source();
const the_land = layer(land, 1);
const the_given = layer(given, 30, (feature) => styled(feature.get("look"), { theme: theme() }));
const the_particles = layer(particles, 8, (feature) => styled(feature.get("look"), { theme: theme(), size: 0.7, opaque: 0.5 }));
const the_likely = layer(likely, 20, (feature) => {
  return [...styled("datum", { theme: theme() }), ...titled("datum", { theme: theme(), label: feature.get("label") })];
}, true);
export const view = new ol.View({
  projection: map.projection,
  center: map.forward([0, 45]),
  resolution: 8000,
  minResolution: 2,
  maxResolution: 60000,
  enableRotation: false,
});
const scale = new ol.control.ScaleLine({ units: "nautical" });
export const chart = new ol.Map({
  target,
  view,
  keyboardEventTarget: target,
  layers: [the_land, the_particles, the_likely, the_given],
  controls: ol.control.defaults.defaults({ rotate: false, attribution: false }).extend([scale]),
});
const grid = graticule(map, view, chart);
const the_grid = /** @type {BaseLayer} */ (chart.getLayers().getArray().at(-1)); // which it has just added

/** What is shown of a first map or a result. */
export const shown = {
  areas: /** @type {Leaf | null} */ (null),
  told: /** @type {Shown | null} */ (null),
  times: /** @type {number[]} */ ([]), // [s since 1970]
  index: 0,
  playing: false,
};

/** @type {(() => void)[]} */
const followers = [];

/**
 * Call something whenever another time is shown, or nothing any more.
 * @param {() => void} follower
 */
export function follow(follower) {
  followers.push(follower);
}

/** Draw the map again in the colours of the page. */
export function paint() {
  const stroke = new ol.style.Stroke({ color: css("--shore"), width: 0.8 });
  the_land.setStyle(new ol.style.Style({ fill: new ol.style.Fill({ color: css("--land") }), stroke }));
  grid.paint({ line: tinted(css("--grid"), 0.6), ink: css("--ink"), halo: css("--halo") });
  for (const one of chart.getLayers().getArray()) one.changed();
  if (shown.areas) move(shown.index);
}

// --- around the Earth ----------------------------------------------------------------------------------------------------
/**
 * Return points [deg] without a jump at 180 degrees, from the first one on: each lies within 180 degrees of the one before it.
 * @param {Point[]} points
 */
function unbroken(points) {
  let before = near(points[0]?.[0] ?? 0, 0);
  return points.map(([lon, lat]) => {
    before = near(lon, before);
    return /** @type {Point} */ ([before, lat]);
  });
}

/**
 * Return a shape of unbroken rings [deg] as often as it lies in the world from 180 W to 180 E: beyond, OpenLayers draws nothing
 * that does not also lie within.
 * @param {Point[][]} rings
 */
function copies(rings) {
  const lons = rings.flat().map(([lon]) => lon);
  const [west, east] = [Math.min(...lons), Math.max(...lons)];
  const turns = [-360, 0, 360].filter((turn) => west + turn < 180 && east + turn > -180);
  return turns.map((turn) => rings.map((ring) => ring.map(([lon, lat]) => map.forward([lon + turn, lat]))));
}

/** @param {Point} at */
const spot = ([lon, lat]) => new ol.geom.Point(map.forward([near(lon, 0), lat]));

/**
 * Return the position [deg] of a point of the map.
 * @param {number[]} at
 * @returns {Point}
 */
export function inverse(at) {
  const [lon, lat] = map.inverse(at);
  return [near(lon, 0), lat];
}

// --- shoreline -----------------------------------------------------------------------------------------------------------
let wanted = 0;
let had = /** @type {{box: number[], step: number} | null} */ (null);
const coast = guarded(async () => {
  const size = chart.getSize();
  if (!size || !size[0]) return;
  const [x0, y0, x1, y1] = view.calculateExtent(size);
  const [[left, south], [right, north]] = [map.inverse([x0, y0]), map.inverse([x1, y1])];
  const middle = near((left + right) / 2, 0);
  const half = (right - left) / 2;
  const fine = ((view.getResolution() ?? 1) / R / RAD) * Math.cos(((south + north) / 2) * RAD);
  const step = Math.min(1, Math.max(1e-4, 2 ** Math.floor(Math.log2(fine))));
  /** @param {number[]} box */
  const holds = ([west, low, east, high]) => {
    const about = near(middle, (west + east) / 2);
    return about - half >= west && south >= low && about + half <= east && north <= high;
  };
  if (had && had.step === step && holds(had.box)) return;
  const wide = Math.min(180, 2 * half);
  const high = north - south;
  const box = [middle - wide, Math.max(-89, south - high / 2), middle + wide, Math.min(89, north + high / 2)];
  if (!(box[0] < box[2] && box[1] < box[3])) return;
  const mine = ++wanted;
  /** @type {Coast} */
  const told = await ask("/api/coast", { box, step });
  if (mine !== wanted) return;
  had = { box, step };
  land.clear(true);
  land.addFeatures(told.features.flatMap((one) => {
    return copies(one.geometry.coordinates).map((rings) => new ol.Feature(new ol.geom.Polygon(rings)));
  }));
});

// its first frame may come before the page is laid out, and no other follows until something changes
new ResizeObserver(() => chart.render()).observe(target);
chart.on("moveend", () => {
  coast();
  const [lon, lat] = inverse(middle_of_view());
  try {
    localStorage.setItem("view", JSON.stringify([lon, lat, view.getResolution()]));
  } catch { /* no storage here */ }
});
try {
  const [lon, lat, resolution] = JSON.parse(localStorage.getItem("view") ?? "");
  view.setCenter(map.forward([lon, lat]));
  view.setResolution(resolution);
} catch { /* the first time */ }

/** Return the middle of the map [deg]. */
export const middle = () => inverse(middle_of_view());

function middle_of_view() {
  return view.getCenter() ?? [0, 0];
}

// --- what the case says of the place -------------------------------------------------------------------------------------
/**
 * Return a circle as a ring [deg].
 * @param {Point} middle
 * @param {number} metres
 * @returns {Point[]}
 */
export function circle([lon, lat], metres) {
  return Array.from({ length: 65 }, (_, k) => {
    const angle = (k * Math.PI) / 32;
    const north = (metres * Math.cos(angle)) / R / RAD;
    return [lon + (metres * Math.sin(angle)) / R / RAD / Math.cos(lat * RAD), lat + north];
  });
}

/** @param {Geometry} geometry @param {string} look @param {string} role */
function mark(geometry, look, role) {
  const feature = new ol.Feature(geometry);
  feature.setProperties({ look, role }, true);
  given.addFeature(feature);
}

/**
 * Show where the object went adrift.
 * @param {Place} place in degrees and metres
 */
export function place({ at, error, line, polygon }) {
  given.clear(true);
  if (at) {
    mark(spot(at), "start", "position");
    if (error) {
      const ring = circle(at, error);
      for (const rings of copies([ring])) mark(new ol.geom.Polygon(rings), "start", "circle");
      mark(spot(ring[16]), "way", "handle"); // to the east
    }
  }
  for (const points of [line, polygon]) {
    if (!points?.length) continue;
    const ring = unbroken(points);
    for (const point of ring) mark(spot(point), "way", "corner");
    if (points === polygon && ring.length > 2) {
      for (const rings of copies([[...ring, ring[0]]])) mark(new ol.geom.Polygon(rings), "start", "shape");
    } else if (ring.length > 1) {
      for (const [one] of copies([ring])) mark(new ol.geom.LineString(one), "start", "shape");
    }
  }
}

/**
 * Return the position [deg] of a point on the map.
 * @param {FeatureLike | undefined} feature
 */
function at_of(feature) {
  const geometry = feature?.getGeometry();
  return geometry instanceof ol.geom.Point ? inverse(geometry.getCoordinates()) : null;
}

const position_given = () => at_of(given.getFeatures().find((one) => one.get("role") === "position"));

/**
 * Let the user drag the position, and the handle of its circle.
 * @param {{position: (at: Point) => void, error: (metres: number) => void}} told called at the end
 */
export function dragging(told) {
  const drag = new ol.interaction.Translate({
    filter: (feature) => ["position", "handle"].includes(feature.get("role")),
    layers: [the_given],
    hitTolerance: 8,
  });
  chart.addInteraction(drag);
  drag.on("translateend", (event) => {
    for (const feature of event.features.getArray()) {
      const at = at_of(feature);
      const middle = position_given();
      if (!at || !middle) continue;
      if (feature.get("role") === "position") told.position(at);
      else told.error(toward(middle, at).distance);
    }
  });
}

/**
 * Move the map so that all points [deg] are on it.
 * @param {Point[]} points
 */
export function look_at(points) {
  const framed = ol.extent.createEmpty();
  const first = points[0]?.[0] ?? 0;
  for (const [lon, lat] of points) ol.extent.extendCoordinate(framed, map.forward([near(lon, first), lat]));
  if (!ol.extent.isEmpty(framed)) view.fit(framed, { padding: [50, 50, 50, 50], minResolution: 40 });
}

// --- picking a place -----------------------------------------------------------------------------------------------------
let picked = /** @type {((at: Point) => void) | null} */ (null);

/**
 * Pass the places that the user clicks to a function, or stop passing them (null).
 * @param {((at: Point) => void) | null} told
 */
export function pick(told) {
  picked = told;
  target.classList.toggle("picking", Boolean(told));
  target.classList.toggle("aimed", Boolean(told) && document.activeElement === target);
}
chart.on("singleclick", (event) => {
  if (!picked) return;
  event.stopPropagation(); // the click chooses nothing else
  picked(inverse(event.coordinate));
});
target.addEventListener("focus", () => target.classList.toggle("aimed", Boolean(picked) && target.matches(":focus-visible")));
target.addEventListener("keydown", (event) => {
  if (event.key !== "Enter" || !picked) return;
  event.preventDefault();
  target.classList.add("aimed");
  picked(inverse(middle_of_view()));
});
/** Whether the next click gives a place. */
export const picking = () => Boolean(picked);

/**
 * Return the smallest area that is shown and holds a place, as its share; null: none.
 * @param {Point} at
 */
export function level_at([lon, lat]) {
  const held = (shown.areas?.every ?? []).filter((feature) => {
    if (feature.get("there") === "gone") return false;
    return [-360, 0, 360].some((turn) => feature.getGeometry()?.intersectsCoordinate(map.forward([lon + turn, lat])));
  });
  return held.length ? Math.min(...held.map((feature) => Number(feature.get("level")))) : null;
}

// --- a first map or a result, by time ------------------------------------------------------------------------------------
/** @returns {BaseLayer[]} */
function layers_of_areas() {
  return shown.areas ? [shown.areas.layer, shown.areas.nameplates].filter((one) => one !== null) : [];
}

/** Show no areas. */
export function clear() {
  for (const one of layers_of_areas()) chart.removeLayer(one);
  Object.assign(shown, { areas: null, times: [], told: null });
  particles.clear(true);
  likely.clear(true);
  get("time").hidden = true;
  play(false);
  for (const follower of followers) follower();
}

/**
 * Show the areas of a first map or a result.
 * @param {Shown} told
 * @param {boolean} [keep] the view and the time stay, and what plays plays on
 */
export function show(told, keep = false) {
  const { playing } = shown;
  const now = keep ? shown.times[shown.index] : undefined;
  clear();
  const features = told.areas.features;
  const leaf = { features, look: "area", when: "at", span: ["time", "time"], where: {}, told: [], title: "Areas" };
  shown.areas = shapes(leaf, null, map, 10);
  for (const one of layers_of_areas()) {
    one.setVisible(!switched_off.has("areas"));
    chart.addLayer(one);
  }
  shown.told = told;
  const own_times = [...new Set(features.map((one) => epoch(one.properties.time)))].sort((a, b) => a - b);
  shown.times = told.times ? told.times.map(epoch) : own_times;
  get("slider").max = String(Math.max(0, shown.times.length - 1));
  get("time").hidden = shown.times.length < 2;
  move(shown.times.length - 1);
  if (now !== undefined) go_to_time(now);
  else if (told.opens) go_to_time(epoch(told.opens));
  if (keep) {
    if (playing && shown.times.length > 1) play(true);
    return;
  }
  const start = position_given();
  const points = features.flatMap((one) => /** @type {Point[]} */ (one.geometry.coordinates.flat(2)));
  look_at(start ? [start, ...points] : points);
}

/**
 * Add what was not known yet to what is shown: particles and most likely places.
 * @param {Partial<Shown>} told
 */
export function add(told) {
  if (!shown.told) return;
  Object.assign(shown.told, told);
  move(shown.index);
}

/**
 * Show another time.
 * @param {number} index
 */
function move(index) {
  const { told, times, areas } = shown;
  if (!told || !areas || !times.length) return;
  const k = Math.max(0, Math.min(times.length - 1, index));
  const time = times[k];
  shown.index = k;
  areas.update({ time, theme: theme() });
  get("slider").value = String(k);
  const start = told.start ? epoch(told.start) : times[0];
  const hours = Number(Math.abs((time - start) / 3600).toFixed(1));
  const label = `${group(time)} (${time < start ? "−" : "+"}${hours} h)`;
  get("now").textContent = label;
  get("slider").setAttribute("aria-valuetext", label);
  particles.clear(true);
  likely.clear(true);
  particles.addFeatures(particles_at(told, k));
  for (const one of told.likely?.[k] ?? []) {
    const feature = new ol.Feature(spot(one.at));
    feature.set("label", one.ashore ? `likeliest coast (${(100 * one.share).toFixed(0)} %)` : "most likely afloat", true);
    likely.addFeature(feature);
  }
  for (const follower of followers) follower();
}

/**
 * Show the output nearest to a time.
 * @param {number} time [s since 1970]
 */
export function go_to_time(time) {
  const off = shown.times.map((one) => Math.abs(one - time));
  if (off.length) move(off.indexOf(Math.min(...off)));
}

/**
 * @param {Shown} told
 * @param {number} k
 */
function particles_at({ particles: held, looks = [] }, k) {
  return (held?.lon[k] ?? []).flatMap((lon, j) => {
    const look = looks[held?.status[k][j] ?? 0];
    if (!look) return [];
    const feature = new ol.Feature(spot([lon, held?.lat[k][j] ?? 0]));
    feature.set("look", look, true);
    return [feature];
  });
}

const EACH = 600; // [ms] that a time is shown
const CALM = 2000; // the same for who wants less motion; then it ends with the last time
const less_motion = window.matchMedia("(prefers-reduced-motion: reduce)");
let timer = 0;

/** @param {boolean} on */
function play(on) {
  shown.playing = on;
  clearTimeout(timer);
  get("play").textContent = on ? "Pause" : "Play";
  get("play").setAttribute("aria-pressed", String(on));
  get("now").setAttribute("aria-live", on ? "off" : "polite"); // else each time is read out
  if (on) timer = setTimeout(next, less_motion.matches ? CALM : EACH);
}

/** Show the next time, after the last one the first. */
function next() {
  const last = shown.index + 1 >= shown.times.length;
  if (last && less_motion.matches) {
    play(false);
    return;
  }
  move(last ? 0 : shown.index + 1);
  play(true);
}

get("slider").addEventListener("input", () => move(Number(get("slider").value)));
get("before").addEventListener("click", () => move(shown.index - 1));
get("after").addEventListener("click", () => move(shown.index + 1));
get("play").addEventListener("click", () => {
  const again = !shown.playing && less_motion.matches && shown.index + 1 >= shown.times.length;
  if (again) move(0);
  play(!shown.playing);
});

// --- layers that can be switched off -------------------------------------------------------------------------------------
const switched_off = /** @type {Set<string>} */ (new Set());
const switched = /** @type {Map<string, BaseLayer[]>} */ (new Map([
  ["areas", []], ["particles", [the_particles]], ["likely", [the_likely]], ["start", [the_given]], ["coast", [the_land]],
  ["graticule", [the_grid]],
]));

/**
 * Have a layer switched with those of a name.
 * @param {string} name
 * @param {BaseLayer} one
 */
export function switch_with(name, one) {
  switched.set(name, [...switched.get(name) ?? [], one]);
}

/** Show the layers that are switched on, and no others. */
function switch_layers() {
  for (const [name, layers] of switched) for (const one of layers) one.setVisible(!switched_off.has(name));
  for (const one of layers_of_areas()) one.setVisible(!switched_off.has("areas"));
}
for (const box of /** @type {HTMLInputElement[]} */ (all("[data-layer]"))) {
  box.addEventListener("change", () => {
    if (box.checked) switched_off.delete(box.dataset.layer ?? "");
    else switched_off.add(box.dataset.layer ?? "");
    switch_layers();
  });
}
