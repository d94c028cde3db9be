"use strict";
// Leaves as layers of the map. Each: {title, look, layer, shown, told(feature) -> [[name, text]], update(now), ready}.
// now: {time [s since 1970], index of the output, last output?, theme, story}.

const format = new ol.format.GeoJSON();

const NAMES = 100; // added to the order of a layer for that of its names, which are above all lines

function vector(source, style, order, declutter = false) {
  return new ol.layer.Vector({ source, style, zIndex: order, declutter, updateWhileAnimating: true });
}

// Outlines without the edges along 180 degrees at which RFC 7946 cuts shapes.
function seamless(feature, map) {
  const geometry = feature.getGeometry(), kind = geometry.getType();
  if (kind !== "Polygon" && kind !== "MultiPolygon") return;
  const rings = (kind === "Polygon" ? [geometry.getCoordinates()] : geometry.getCoordinates()).flat();
  const at180 = point => Math.abs(Math.abs(near(map.inverse(point)[0], 0)) - 180) < 1e-6;
  const lines = [];
  for (const ring of rings) {
    let line = [ring[0]];
    for (let k = 1; k < ring.length; k++) {
      if (at180(ring[k - 1]) && at180(ring[k])) {
        if (line.length > 1) lines.push(line);
        line = [ring[k]];
      } else line.push(ring[k]);
    }
    if (line.length > 1) lines.push(line);
  }
  feature.set("outline", new ol.geom.MultiLineString(lines), true);
}

function read(collection, map) {
  const features = format.readFeatures(collection, { dataProjection: "EPSG:4326", featureProjection: map.projection })
    .filter(feature => feature.getGeometry());
  features.forEach(feature => seamless(feature, map));
  return features;
}

function matches(feature, where) {
  return Object.entries(where).every(([name, value]) => (Array.isArray(value) ? value : [value]).includes(feature.get(name)));
}

// Whether a shape is shown at a time, and how: "gone" (hidden), "there" (normal), "now" (bold).
function presence(feature, { when, span }, time) {
  if (when === "always") return "there";
  const [begin, end] = span.map(name => epoch(feature.get(name) || feature.get("time")));
  if (when === "at") return begin === time ? "there" : "gone";
  if (Number.isNaN(begin)) return "there";
  if (time < begin) return "gone";
  return when === "during" && time < end ? "now" : "there";
}

const SEQUENCE = ["#d7b5e8", "#b77fd4", "#9650bb", "#76289c", "#4a0d67"]; // colours of graded shapes, from the smallest value

// Values by time and key of a table that grades shapes, and their maximum: {at: {time: {key: value}}, most}.
function grades({ file, key, column }, files) {
  const table = files.table(file), [when, which, what] = ["time", key, column].map(name => table.header.indexOf(name));
  const found = { at: new Map(), most: 1e-12 };
  for (const row of table.rows) {
    const time = epoch(row[when]), value = Number(row[what]);
    if (!found.at.has(time)) found.at.set(time, new Map());
    found.at.get(time).set(row[which], value);
    found.most = Math.max(found.most, value);
  }
  return found;
}

function shapes(leaf, files, map, order) {
  const collection = leaf.features ? { type: "FeatureCollection", features: leaf.features } : files.json(leaf.file);
  const every = read(collection, map).filter(feature => matches(feature, leaf.where));
  const graded = leaf.graded && grades(leaf.graded, files);
  const levels = [...new Set(every.map(feature => feature.get("level")))].filter(level => level !== undefined).sort((a, b) => a - b);
  const source = new ol.source.Vector({ wrapX: map.around });
  let now = null;
  const looks = feature => {
    const there = feature.get("there"), options = { theme: now.theme, strong: there === "now", pale: leaf.when === "during" && there === "there" };
    if (leaf.label) options.label = String(feature.get(leaf.label) ?? "");
    if (levels.length) {
      const k = levels.indexOf(feature.get("level"));
      options.share = k / Math.max(levels.length - 1, 1);
      options.dash = k === levels.length - 1 && k > 0 ? [2, 3] : DASHES[k % DASHES.length];
      options.width = k ? (k === levels.length - 1 ? 1.4 : 1.8) : 2.4;
      options.label = leaf.look === "coast" ? "" : `${Number((100 * feature.get("level")).toPrecision(6))} %`;
      options.along = true;
    }
    if (graded) {
      const share = Math.sqrt(feature.get("grade") / graded.most);
      const shades = now.theme === "dark" ? [...SEQUENCE].reverse() : SEQUENCE;
      options.colour = shades[Math.min(shades.length - 1, Math.floor(share * shades.length))];
      options.width = 2.5 + 5 * share;
    }
    return options;
  };
  const band = leaf.look === "coast" && levels.length > 0;
  const layer = vector(source, feature => band ? banded(leaf.look, now.theme, looks(feature).share) : styled(leaf.look, looks(feature)), order);
  const named = leaf.label || (levels.length > 0 && !band);
  const nameplates = named ? vector(source, feature => titled(leaf.look, looks(feature)), NAMES + order, true) : null;
  return {
    ...leaf, layer, nameplates, every,
    update(next) {
      now = next;
      const there = every.filter(feature => {
        const grade = graded && graded.at.get(now.time)?.get(String(feature.get(leaf.graded.key)));
        feature.set("grade", grade, true);
        feature.set("there", graded && !(grade > 0) ? "gone" : presence(feature, leaf, now.time), true);
        return feature.get("there") !== "gone";
      });
      source.clear(true);
      source.addFeatures(there);
      layer.changed();
      nameplates?.changed();
    },
    told: feature => leaf.told.map(([name, header, form]) => [header, written(feature.get(name), form)]),
  };
}

// Classes of points by cumulative weight, heaviest first: up to half of the total, then up to these shares. Size and opacity of each
// class are relative to the look: thousands of cells with almost no weight must not hide the few that matter.
const HELD = [0.5, 0.75, 0.9, 0.97], SIZES = [1.5, 1.1, 0.8, 0.6, 0.45], OPAQUE = [1, 0.8, 0.55, 0.35, 0.18];

// The class of each weight; 0: the heaviest, up to the first of the shares.
function classes(weights) {
  const order = weights.map((weight, k) => k).sort((a, b) => weights[b] - weights[a]), made = [];
  const whole = weights.reduce((sum, weight) => sum + weight, 0);
  let held = 0;
  for (const k of order) {
    made[k] = HELD.filter(share => held >= share * whole).length; // by the sum of those before it: the heaviest is always in the first class
    held += weights[k];
  }
  return made;
}

function points(leaf, files, map, order) {
  const table = files.table(leaf.file), column = name => table.header.indexOf(name);
  const [lon, lat, since, weight] = ["lon", "lat", leaf.since, leaf.weight].map(column);
  const made = weight < 0 ? [] : classes(table.rows.map(row => Number(row[weight])));
  const every = table.rows.map((row, k) => {
    const feature = new ol.Feature(new ol.geom.Point(map.forward([Number(row[lon]), Number(row[lat])])));
    feature.set("row", row, true);
    feature.set("size", weight < 0 ? 0 : made[k], true);
    feature.set("since", since < 0 ? -Infinity : epoch(row[since]), true);
    return feature;
  });
  const source = new ol.source.Vector({ wrapX: false });
  let styles = [];
  every.sort((a, b) => b.get("size") - a.get("size")); // the heaviest are drawn on top
  const layer = vector(source, feature => styles[feature.get("size")], order);
  return {
    ...leaf, layer, every,
    update(now) {
      styles = SIZES.map((size, k) => styled(leaf.look, { theme: now.theme, size, opaque: OPAQUE[k] }));
      source.clear(true);
      source.addFeatures(every.filter(feature => feature.get("since") <= now.time));
      layer.changed();
    },
    told: feature => leaf.told.map(([name, header, form]) => [header, written(feature.get("row")[column(name)], form)]),
  };
}

function track(leaf, files, map, order) {
  const table = files.table(leaf.file), column = name => table.header.indexOf(name);
  const fixes = table.rows.map(row => ({ time: epoch(row[column("time")]), at: [Number(row[column(leaf.lon)] || NaN), Number(row[column(leaf.lat)] || NaN)] }))
    .filter(fix => fix.at.every(Number.isFinite));
  const line = new ol.Feature(new ol.geom.LineString(fixes.map(fix => map.forward(fix.at))));
  const point = new ol.Feature(new ol.geom.Point([0, 0]));
  const source = new ol.source.Vector({ wrapX: false, features: [line] });
  let theme = "light";
  const layer = vector(source, () => styled(leaf.look, { theme }), order);
  const nameplates = vector(source, feature => titled(leaf.look, { theme, label: feature === point ? leaf.title : "" }), NAMES + order, true);
  return {
    ...leaf, layer, nameplates, every: [line], fixes,
    update(now) {
      theme = now.theme;
      const fix = fixes.find(one => one.time === now.time);
      if (source.hasFeature(point)) source.removeFeature(point);
      if (fix) {
        point.setGeometry(new ol.geom.Point(map.forward(fix.at)));
        source.addFeature(point);
      }
      layer.changed();
      nameplates.changed();
    },
    told: feature => {
      const fix = feature === point && fixes.find(one => map.forward(one.at).join() === point.getGeometry().getCoordinates().join());
      return fix ? [["Position", position(fix.at)], ["Time", group(fix.time)]] : [];
    },
  };
}

function sample(leaf, files, map, order) {
  const many = leaf.time.length, data = {};
  const ready = Promise.all([unpack.floats(leaf.lon), unpack.floats(leaf.lat), unpack.bytes(leaf.status)]).then(([lon, lat, status]) => {
    data.points = Array.from(lon, (value, k) => map.forward([value, lat[k]]));
    data.status = status;
  });
  const source = new ol.source.Vector({ wrapX: false });
  let theme = "light";
  const layer = vector(source, feature => styled("sample", { theme, width: feature.getGeometry().getType() === "Point" ? 0.5 : 0.6, pale: true }), order);
  const away = new Set(["pending", "left", "outside", "sunk"]);
  return {
    ...leaf, look: "sample", layer, every: [], ready,
    update(now) {
      theme = now.theme;
      source.clear(true);
      const k = leaf.time.indexOf(now.time);
      if (!data.points || k < 0 || !layer.getVisible()) return;
      const drawn = [];
      for (let one = 0; one < leaf.number; one++) {
        if (now.story > 0 && leaf.story[one] !== now.story - 1) continue;
        const names = Array.from({ length: k + 1 }, (_, t) => leaf.names[data.status[one * many + t]]);
        if (away.has(names[k])) continue;
        const first = names.findIndex(name => name !== "pending");
        const way = data.points.slice(one * many + first, one * many + k + 1);
        if (way.length > 1) drawn.push(new ol.Feature(new ol.geom.LineString(way)));
        const point = new ol.Feature(new ol.geom.Point(way[way.length - 1]));
        point.set("words", names[k].replaceAll("_", " "), true);
        drawn.push(point);
      }
      source.addFeatures(drawn);
    },
    told: feature => feature.get("words") ? [["A particle of the sample is", feature.get("words")]] : [],
  };
}

// Arrows of a flow: FULL pixels is the length of the fastest of all times.
const FULL = 34;

function arrows(leaf, files, map, order) {
  const many = leaf.lon.length, places = leaf.lon.map((lon, k) => [lon, leaf.lat[k]]);
  const source = new ol.source.Vector({ wrapX: false });
  let theme = "light", velocity = null, fastest = 0;
  const ready = unpack.floats(leaf.velocity).then(values => {
    velocity = values;
    for (let k = 0; k < values.length; k += 2) if (Number.isFinite(values[k])) fastest = Math.max(fastest, Math.hypot(values[k], values[k + 1]));
  });
  const layer = vector(source, null, order);
  layer.setStyle((feature, resolution) => {
    const { width, dash } = LOOKS[leaf.look], [east, north] = feature.get("velocity"), speed = Math.hypot(east, north);
    const [x, y] = feature.getGeometry().getCoordinates(), turn = feature.get("turn");
    const long = (FULL * resolution * speed) / (fastest || 1), c = Math.cos(turn), s = Math.sin(turn);
    const tip = [x + (long * (east * c - north * s)) / (speed || 1), y + (long * (east * s + north * c)) / (speed || 1)];
    const head = Math.min(8 * resolution, long * 0.45), angle = Math.atan2(tip[1] - y, tip[0] - x);
    const barb = side => [tip[0] - head * Math.cos(angle + side), tip[1] - head * Math.sin(angle + side)];
    const colour = INKS[theme][LOOKS[leaf.look].ink];
    return [
      new ol.style.Style({ geometry: new ol.geom.LineString([[x, y], tip]), stroke: new ol.style.Stroke({ color: colour, width, lineDash: dash }) }),
      new ol.style.Style({ geometry: new ol.geom.LineString([barb(0.45), tip, barb(-0.45)]), stroke: new ol.style.Stroke({ color: colour, width }) }),
    ];
  });
  // Where north lies on the map at a place [rad to the left of up].
  const turns = places.map(([lon, lat]) => {
    const [x0, y0] = map.forward([lon, lat]), [x1, y1] = map.forward([lon, lat + (lat > 89 ? -0.01 : 0.01)]);
    return Math.atan2(y1 - y0, x1 - x0) - Math.PI / 2 + (lat > 89 ? Math.PI : 0);
  });
  return {
    ...leaf, layer, every: [], ready,
    update(now) {
      theme = now.theme;
      source.clear(true);
      const k = leaf.time.indexOf(now.time);
      if (!velocity || k < 0) return;
      source.addFeatures(places.map((place, j) => {
        const at = 2 * (k * many + j), feature = new ol.Feature(new ol.geom.Point(map.forward(place)));
        feature.setProperties({ velocity: [velocity[at], velocity[at + 1]], turn: turns[j] }, true);
        return feature;
      }).filter(feature => feature.get("velocity").every(Number.isFinite)));
    },
    told: feature => {
      const [east, north] = feature.get("velocity"), knots = (Math.hypot(east, north) * 3600) / NMI;
      const toward = (Math.atan2(east, north) / RAD + 360) % 360, from = (toward + 180) % 360;
      const degrees = value => String(Math.round(value) % 360).padStart(3, "0");
      return [[leaf.title, leaf.look === "wind" ? `${knots.toFixed(0)} kn from ${degrees(from)}°` : `${knots.toFixed(1)} kn toward ${degrees(toward)}°`]];
    },
  };
}

// Probability maps: the bytes of a time and scenario, drawn by looking up the cell under each pixel.
function maps(leaf, files, map, order) {
  const kept = new Map();
  async function cells(which, k) {
    const key = `${which} ${k}`;
    if (!kept.has(key)) {
      const frames = which === "containment" ? leaf.containment.frames : leaf.density[which].frames;
      kept.set(key, unpack.frame(frames[k]));
    }
    return kept.get(key);
  }
  const { lon, lat } = leaf, column = value => Math.floor((near(value, lon.first + (lon.step * lon.size) / 2) - lon.first) / lon.step + 0.5);
  const row = value => Math.floor((value - lat.first) / lat.step + 0.5);
  const byte = (frame, r, c) => {
    const [i, j] = [r - frame.row, c - frame.column];
    return i >= 0 && j >= 0 && i < frame.rows && j < frame.columns ? frame.values[i * frame.columns + j] : 0;
  };
  let frame = null, held = null, colours = null, now = null, top = 1, index = null, indexed = "", asked = 0;
  const canvas = document.createElement("canvas"), context = canvas.getContext("2d");

  // The cell under each pixel, -1 outside; rows and columns are computed separately if the projection allows.
  function look(extent, wide, high) {
    const key = [extent, wide, high].join();
    if (key === indexed) return;
    indexed = key;
    index = new Int32Array(wide * high);
    const at = (i, j) => map.inverse([extent[0] + ((j + 0.5) / wide) * (extent[2] - extent[0]), extent[3] - ((i + 0.5) / high) * (extent[3] - extent[1])]);
    const inside = (r, c) => r >= 0 && c >= 0 && r < lat.size && c < lon.size ? r * lon.size + c : -1;
    if (map.separable) {
      const rows = Int32Array.from({ length: high }, (_, i) => row(at(i, 0)[1])), columns = Int32Array.from({ length: wide }, (_, j) => column(at(0, j)[0]));
      for (let i = 0; i < high; i++) for (let j = 0; j < wide; j++) index[i * wide + j] = inside(rows[i], columns[j]);
    } else {
      for (let i = 0; i < high; i++) for (let j = 0; j < wide; j++) {
        const [x, y] = at(i, j);
        index[i * wide + j] = inside(row(y), column(x));
      }
    }
  }

  function draw(extent, resolution, ratio, size) {
    const [wide, high] = size.map(Math.round);
    canvas.width = wide;
    canvas.height = high;
    if (!frame) return canvas;
    look(extent, wide, high);
    const scale = leaf.density[now.story], lut = new Uint32Array(256);
    for (let q = 1; q < 256; q++) lut[q] = colours[Math.min(255, Math.round(255 * Math.sqrt(Math.min(1, unpack.density(scale, q) / top))))];
    const least = held ? 1 + Math.round((1 - leaf.shown) * (leaf.containment.levels - 1)) : 0;
    const image = context.createImageData(wide, high), pixels = new Uint32Array(image.data.buffer);
    for (let p = 0; p < pixels.length; p++) {
      if (index[p] < 0) continue;
      const r = Math.floor(index[p] / lon.size), c = index[p] - r * lon.size, q = byte(frame, r, c);
      if (q && (!held || byte(held, r, c) >= least)) pixels[p] = lut[q];
    }
    context.putImageData(image, 0, 0);
    return canvas;
  }

  const source = new ol.source.ImageCanvas({ canvasFunction: draw, projection: map.projection, ratio: 1, interpolate: false });
  const layer = new ol.layer.Image({ source, zIndex: order });
  return {
    ...leaf, look: "", layer, every: [], shown: true,
    async update(next) {
      const k = leaf.time.indexOf(next.time), mine = ++asked, story = Math.min(next.story, leaf.density.length - 1);
      const found = k < 0 ? [null, null] : await Promise.all([cells(story, k), leaf.containment && !story ? cells("containment", k) : null]);
      if (mine !== asked) return; // a newer update has been requested
      now = { ...next, story };
      [frame, held] = found;
      top = k < 0 ? 1 : leaf.top[k];
      if (now.story && frame) {
        const scale = leaf.density[now.story]; // a scenario's colour scale ends with its own densest cells
        top = Math.min(top, unpack.density(scale, frame.values.reduce((a, b) => Math.max(a, b), 0)));
      }
      colours = shading(now.theme, leaf.pale[Math.max(k, 0)] ? PALE : FULL_COLOUR);
      source.changed();
    },
    scale: () => ({ colours, top: top * NMI * NMI }),
    // The values at a position [deg]: density [1/nmi2], and the smallest share whose area contains it.
    at([x, y]) {
      const r = row(y), c = column(x);
      if (!frame || r < 0 || c < 0 || r >= lat.size || c >= lon.size) return null;
      const density = unpack.density(leaf.density[now.story], byte(frame, r, c)) * NMI * NMI;
      return { density, share: held && byte(held, r, c) ? unpack.share(leaf.containment, byte(held, r, c)) : null };
    },
    told: () => [],
  };
}

const LAYERS = { maps, shapes, points, track, sample, arrows };
