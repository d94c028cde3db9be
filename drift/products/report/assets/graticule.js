"use strict";
// Meridians and parallels of the view, each with its own step, which OpenLayers' graticule does not support: near a pole
// meridians would be as dense as parallels.
const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 2700]; // arc minutes
const LINES = 7; // most in each direction

function degrees(value, digits, positive, negative) {
  const tenths = Math.round(Math.abs(value) * 600), whole = Math.floor(tenths / 600), rest = (tenths % 600) / 10;
  const side = tenths === 0 || tenths === 108000 ? "" : value > 0 ? positive : negative;
  return `${String(whole).padStart(digits, "0")}°${rest % 1 ? rest.toFixed(1).padStart(4, "0") : String(rest).padStart(2, "0")}'${side}`;
}

function graticule(map, view, chart) {
  const source = new ol.source.Vector({ wrapX: false });
  let inks = { line: "#888", ink: "#000", halo: "#fff" };
  const layer = new ol.layer.Vector({ source, zIndex: 6, style: feature => feature.get("label") ? lettering(feature) :
    new ol.style.Style({ stroke: new ol.style.Stroke({ color: inks.line, width: 0.7 }) }) });

  function lettering(feature) {
    const left = feature.get("left");
    return new ol.style.Style({ text: new ol.style.Text({
      text: feature.get("label"), font: "12px system-ui, sans-serif", fill: new ol.style.Fill({ color: inks.ink }),
      stroke: new ol.style.Stroke({ color: inks.halo, width: 3 }), textAlign: left ? "left" : "center", textBaseline: left ? "middle" : "bottom",
      offsetX: left ? 3 : 0, offsetY: left ? 0 : -3,
    }) });
  }

  // Where a line crosses an edge: axis 0 for the left edge, 1 for the lower one.
  function crossing(line, axis, edge) {
    for (let k = 1; k < line.length; k++) {
      const [a, b] = [line[k - 1], line[k]];
      if ((a[axis] - edge) * (b[axis] - edge) <= 0 && a[axis] !== b[axis]) {
        const share = (edge - a[axis]) / (b[axis] - a[axis]), other = 1 - axis, point = [0, 0];
        point[axis] = edge;
        point[other] = a[other] + share * (b[other] - a[other]);
        return point;
      }
    }
    return null;
  }

  function update() {
    const size = chart.getSize();
    if (!size || !size[0]) return;
    const [x0, y0, x1, y1] = view.calculateExtent(size), places = [];
    for (let i = 0; i <= 16; i++) for (let j = 0; j <= 16; j++) places.push(map.inverse([x0 + ((x1 - x0) * i) / 16, y0 + ((y1 - y0) * j) / 16]));
    const lons = places.map(place => place[0]), lats = places.map(place => place[1]).filter(Number.isFinite);
    let [south, north] = [Math.max(-90, Math.min(...lats)), Math.min(90, Math.max(...lats))];
    let [west, east] = [Math.min(...lons), Math.max(...lons)];
    for (const pole of [90, -90]) {
      const [x, y] = map.forward([0, pole]);
      if (map.separable || x < x0 || x > x1 || y < y0 || y > y1) continue;
      [west, east] = [west - 180, west + 179.99];
      if (pole > 0) north = 90; else south = -90;
    }
    const step = range => STEPS.find(minutes => (range * 60) / minutes <= LINES) || STEPS[STEPS.length - 1];
    const drawn = [];
    const add = (line, label, axis) => {
      drawn.push(new ol.Feature(new ol.geom.LineString(line)));
      const [low, high] = axis ? [x0, x1] : [y0, y1], at = crossing(line, axis, axis ? y0 : x0);
      if (!at || at[1 - axis] < low + 0.06 * (high - low) || at[1 - axis] > high - 0.03 * (high - low)) return;
      const feature = new ol.Feature(new ol.geom.Point(at));
      feature.setProperties({ label, left: axis === 0 }, true);
      drawn.push(feature);
    };
    const along = (low, high, make) => Array.from({ length: 61 }, (_, k) => map.forward(make(low + ((high - low) * k) / 60)));
    const tall = step(north - south) / 60, wide = step(east - west) / 60;
    for (let lat = Math.ceil(south / tall) * tall; lat <= north; lat += tall) if (Math.abs(lat) < 89.999) add(along(west - 1, east + 1, lon => [lon, lat]), degrees(lat, 2, "N", "S"), 0);
    for (let lon = Math.ceil(west / wide) * wide; lon <= east; lon += wide) add(along(Math.max(-90, south - tall), Math.min(90, north + tall), lat => [lon, lat]), degrees(near(lon, 0), 3, "E", "W"), 1);
    source.clear(true);
    source.addFeatures(drawn);
  }

  chart.addLayer(layer);
  chart.on("moveend", update);
  return {
    paint(colours) {
      inks = colours;
      layer.changed();
    },
  };
}
