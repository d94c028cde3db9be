"use strict";
// The map of the desk: the shoreline, what the case says of the place, and the areas of a sketch or a result.
const sea = (() => {
  const get = (id) => document.getElementById(id);
  const target = get("map"), map = projected({ kind: "mercator", lon: 0, lat: 0 });
  const source = () => new ol.source.Vector({ wrapX: false });
  const layer = (from, zIndex, style) => new ol.layer.Vector({ source: from, zIndex, style, updateWhileAnimating: true });
  const theme = () => document.documentElement.dataset.theme || "light";
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  const land = source(), given = source(), particles = source(), likely = source();
  const theLand = layer(land, 1);
  const theGiven = layer(given, 30, (feature) => styled(feature.get("look"), { theme: theme() }));
  const theParticles = layer(particles, 8, (feature) => styled(feature.get("look"), { theme: theme(), size: 0.7, opaque: 0.5 }));
  const theLikely = layer(likely, 20, () => [...styled("datum", { theme: theme() }), ...titled("datum", { theme: theme(), label: "most likely" })]);
  const view = new ol.View({ projection: map.projection, center: map.forward([0, 45]), resolution: 8000, minResolution: 2, maxResolution: 60000, enableRotation: false });
  const chart = new ol.Map({
    target, view, keyboardEventTarget: target, layers: [theLand, theParticles, theLikely, theGiven],
    controls: ol.control.defaults.defaults({ rotate: false, attribution: false }),
  });
  const grid = graticule(map, view, chart);

  function paint() {
    theLand.setStyle(new ol.style.Style({ fill: new ol.style.Fill({ color: css("--land") }), stroke: new ol.style.Stroke({ color: css("--shore"), width: 0.8 }) }));
    grid.paint({ line: tinted(css("--grid"), 0.6), ink: css("--ink"), halo: css("--halo") });
    for (const one of [theGiven, theParticles, theLikely]) one.changed();
    if (shown.areas) move(shown.index);
  }
  document.addEventListener("colours", paint);

  // --- shoreline ---------------------------------------------------------------------------------------------------------
  let wanted = 0, had = null;
  const coast = desk_guard(async () => {
    const size = chart.getSize();
    if (!size || !size[0]) return;
    const [x0, y0, x1, y1] = view.calculateExtent(size);
    const [west, south] = map.inverse([x0, y0]), [east, north] = map.inverse([x1, y1]);
    const fine = (view.getResolution() / R / RAD) * Math.cos(((south + north) / 2) * RAD);
    const step = Math.min(1, Math.max(1e-4, 2 ** Math.floor(Math.log2(fine))));
    if (had && had.step === step && west >= had.box[0] && south >= had.box[1] && east <= had.box[2] && north <= had.box[3]) return;
    const [wide, high] = [0.5 * (east - west), 0.5 * (north - south)], middle = Math.max(-180, Math.min(180, (west + east) / 2));
    const box = [Math.max(middle - 180, west - wide), Math.max(-89, south - high), Math.min(middle + 180, east + wide), Math.min(89, north + high)];
    if (!(box[0] < box[2] && box[1] < box[3])) return;
    const mine = ++wanted;
    const told = await desk.ask("/api/coast", { box, step });
    if (mine !== wanted) return;
    had = { box, step };
    land.clear(true);
    land.addFeatures(told.features.map((one) => new ol.Feature(new ol.geom.Polygon(one.geometry.coordinates.map((ring) => ring.map(forward))))));
  });
  // Without the jump at 180 degrees: shapes continue beyond.
  function forward([lon, lat]) {
    const [, y] = map.forward([0, lat]);
    return [R * RAD * lon, y];
  }
  function desk_guard(work) { return (...given) => desk.guarded(work)(...given); }
  chart.on("moveend", () => {
    coast();
    const [lon, lat] = map.inverse(view.getCenter());
    try { localStorage.setItem("view", JSON.stringify([lon, lat, view.getResolution()])); } catch { /* no storage here */ }
  });
  try {
    const [lon, lat, resolution] = JSON.parse(localStorage.getItem("view"));
    view.setCenter(map.forward([lon, lat]));
    view.setResolution(resolution);
  } catch { /* the first time */ }

  // --- what the case says of the place -----------------------------------------------------------------------------------
  const circle = ([lon, lat], metres) => new ol.geom.Polygon([Array.from({ length: 65 }, (_, k) => {
    const a = (k * Math.PI) / 32, north = (metres * Math.cos(a)) / R / RAD;
    return forward([lon + (metres * Math.sin(a)) / R / RAD / Math.cos(lat * RAD), lat + north]);
  })]);

  function mark(geometry, look, role) {
    const feature = new ol.Feature(geometry);
    feature.setProperties({ look, role }, true);
    given.addFeature(feature);
    return feature;
  }

  // place: {at, error} or {line} or {polygon}, in degrees and metres.
  function place({ at, error, line, polygon }) {
    given.clear(true);
    if (at) {
      mark(new ol.geom.Point(map.forward(at)), "start", "position");
      if (error) {
        mark(circle(at, error), "start", "circle");
        mark(new ol.geom.Point(forward([at[0] + error / R / RAD / Math.cos(at[1] * RAD), at[1]])), "way", "handle");
      }
    }
    for (const points of [line, polygon]) {
      if (!points?.length) continue;
      const ring = points.map(map.forward);
      for (const point of ring) mark(new ol.geom.Point(point), "way", "corner");
      if (points === polygon && ring.length > 2) mark(new ol.geom.Polygon([[...ring, ring[0]]]), "start", "shape");
      else if (ring.length > 1) mark(new ol.geom.LineString(ring), "start", "shape");
    }
  }

  const drag = new ol.interaction.Translate({ filter: (feature) => ["position", "handle"].includes(feature.get("role")), layers: [theGiven], hitTolerance: 8 });
  chart.addInteraction(drag);
  drag.on("translateend", (event) => {
    for (const feature of event.features.getArray()) {
      const at = map.inverse(feature.getGeometry().getCoordinates()), role = feature.get("role");
      const middle = given.getFeatures().find((one) => one.get("role") === "position");
      if (role === "position") emit("dragged", { at });
      else if (middle) emit("dragged", { error: toward(map.inverse(middle.getGeometry().getCoordinates()), at).distance });
    }
  });

  function look_at(points) {
    const framed = ol.extent.createEmpty();
    for (const point of points) ol.extent.extendCoordinate(framed, map.forward(point));
    if (!ol.extent.isEmpty(framed)) view.fit(framed, { padding: [50, 50, 50, 50], minResolution: 40 });
  }

  // --- picking a place ---------------------------------------------------------------------------------------------------
  let picking = false;
  function pick(on) {
    picking = on;
    target.classList.toggle("picking", on);
    target.classList.toggle("aimed", on && document.activeElement === target);
  }
  function emit(name, detail) {
    document.dispatchEvent(new CustomEvent(name, { detail }));
  }
  chart.on("singleclick", (event) => picking && emit("picked", map.inverse(event.coordinate)));
  target.addEventListener("focus", () => target.classList.toggle("aimed", picking && target.matches(":focus-visible")));
  target.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !picking) return;
    event.preventDefault();
    target.classList.add("aimed");
    emit("picked", map.inverse(view.getCenter()));
  });
  chart.on("pointermove", (event) => {
    if (!event.dragging) get("readout").textContent = position(map.inverse(event.coordinate));
  });

  // --- a sketch or a result, by time -------------------------------------------------------------------------------------
  const shown = { areas: null, times: [], index: 0, told: null, playing: false };

  function clear() {
    if (shown.areas) for (const one of [shown.areas.layer, shown.areas.nameplates]) if (one) chart.removeLayer(one);
    Object.assign(shown, { areas: null, times: [], told: null, playing: false });
    particles.clear(true);
    likely.clear(true);
    get("time").hidden = true;
    get("play").textContent = "Play";
    get("play").setAttribute("aria-pressed", false);
  }

  // told: {areas, times?, likely?, particles?, opens?}
  function show(told) {
    clear();
    const features = told.areas.features;
    const leaf = { features, look: "area", when: "at", span: ["time", "time"], where: {}, told: [], title: "Areas" };
    shown.areas = shapes(leaf, null, map, 10);
    for (const one of [shown.areas.layer, shown.areas.nameplates]) if (one) chart.addLayer(one);
    shown.told = told;
    shown.times = told.times ? told.times.map(epoch) : [...new Set(features.map((one) => epoch(one.properties.time)))].sort((a, b) => a - b);
    get("slider").max = Math.max(0, shown.times.length - 1);
    get("time").hidden = shown.times.length < 2;
    const opens = told.opens ? shown.times.indexOf(epoch(told.opens)) : -1;
    move(opens >= 0 ? opens : shown.times.length - 1);
    const points = features.flatMap((one) => one.geometry.coordinates.flat(2));
    const start = given.getFeatures().filter((one) => one.get("role") === "position").map((one) => map.inverse(one.getGeometry().getCoordinates()));
    look_at([...points, ...start]);
  }

  function move(index) {
    shown.index = Math.max(0, Math.min(shown.times.length - 1, index));
    const { told, times } = shown, time = times[shown.index], k = shown.index;
    shown.areas.update({ time, theme: theme() });
    get("slider").value = k;
    const label = `${group(time)} (${time < times[0] ? "−" : "+"}${Number(Math.abs((time - times[0]) / 3600).toFixed(1))} h)`;
    get("now").textContent = label;
    get("slider").setAttribute("aria-valuetext", label);
    particles.clear(true);
    likely.clear(true);
    if (told.particles) {
      const { lon, lat, status } = told.particles;
      particles.addFeatures(lon[k].flatMap((x, j) => {
        const look = told.looks[status[k][j]];
        if (!look) return [];
        const feature = new ol.Feature(new ol.geom.Point(map.forward([x, lat[k][j]])));
        feature.set("look", look, true);
        return [feature];
      }));
    }
    if (told.likely?.[k]) likely.addFeature(new ol.Feature(new ol.geom.Point(map.forward(told.likely[k]))));
  }
  get("slider").addEventListener("input", () => move(Number(get("slider").value)));
  get("before").addEventListener("click", () => move(shown.index - 1));
  get("after").addEventListener("click", () => move(shown.index + 1));
  get("play").addEventListener("click", async () => {
    shown.playing = !shown.playing;
    get("play").textContent = shown.playing ? "Pause" : "Play";
    get("play").setAttribute("aria-pressed", shown.playing);
    while (shown.playing) {
      await new Promise((done) => setTimeout(done, 600));
      if (shown.playing) move(shown.index + 1 < shown.times.length ? shown.index + 1 : 0);
    }
  });
  return { place, pick, look_at, show, clear, chart, map, view, land, shown, paint };
})();
