"use strict";
// The page: the time that is shown, the pointer, tables and files.
(async () => {
  const get = id => document.getElementById(id);
  const data = JSON.parse(get("data").textContent);
  const packedLand = unpack.words(data.land);
  const needed = [...new Set(data.leaves.flatMap(leaf => [leaf.file, leaf.graded?.file]).filter(Boolean))];
  const texts = new Map(await Promise.all(needed.map(async name => [name, await unpack.words(data.files[name].data)])));
  const parsed = new Map();
  const once = (name, make) => {
    if (!parsed.has(name)) parsed.set(name, make(texts.get(name)));
    return parsed.get(name);
  };
  const files = { json: name => once(name, JSON.parse), table: name => once(name, unpack.table), text: name => texts.get(name) };

  // Header and footer.
  get("title").textContent = data.title;
  if (data.caution) {
    get("caution").textContent = data.caution;
    get("caution").hidden = false;
  }
  const headlines = data.leaves.filter(one => one.leaf === "headline").sort((a, b) => b.first - a.first);
  for (const leaf of headlines) get("headline").append(element("p", leaf.words));
  for (const warning of data.warnings) get("warnings").append(element("li", warning));
  const { attributes } = data;
  get("footer").textContent = `${data.source}. Run ${attributes.run_id}, ${attributes.date_created}. Versions: ${attributes.versions}. Map: OpenLayers ${ol.util.VERSION} (BSD 2-Clause).`;

  // The map.
  const map = projected(data.projection);
  const [west, south, east, north] = data.projection.extent;
  const view = new ol.View({ projection: map.projection, center: map.forward([data.projection.lon, data.projection.lat]), resolution: 1000,
    minResolution: 2, multiWorld: true, showFullExtent: true, constrainRotation: 1, enableRotation: false });
  const theLand = new ol.layer.Vector({ zIndex: 5, source: new ol.source.Vector({ wrapX: false }) });
  const target = get("map");
  const chart = new ol.Map({
    target, view, keyboardEventTarget: target, layers: [theLand],
    controls: ol.control.defaults.defaults({ rotate: false, attribution: false }).extend([new ol.control.ScaleLine({ units: "nautical" })]),
  });

  const grid = graticule(map, view, chart);
  const ORDER = { maps: 1, shapes: 10, points: 12, arrows: 14, sample: 13, track: 16 };
  const over = leaf => (leaf.label ? 5 : leaf.look === "coast" ? 2.5 : 0); // names on top; coastal areas above stranded cells
  const layers = data.leaves.filter(leaf => LAYERS[leaf.leaf]).map((leaf, k) => LAYERS[leaf.leaf](leaf, files, map, ORDER[leaf.leaf] + over(leaf) + k / 100))
    .filter(one => one.every.length || one.ready || one.leaf === "maps");
  for (const one of layers) {
    one.layer.setVisible(one.shown);
    chart.addLayer(one.layer);
    if (!one.nameplates) continue;
    one.nameplates.setVisible(one.shown);
    one.layer.on("change:visible", () => one.nameplates.setVisible(one.layer.getVisible()));
    chart.addLayer(one.nameplates);
  }
  const raster = layers.find(one => one.leaf === "maps");
  const times = raster ? raster.time : [...new Set(layers.flatMap(one => one.time || []))].sort((a, b) => a - b);

  // The state, and everything derived from it.
  // The page opens at the output nearest to the requested time, else at the last one.
  const off = k => Math.abs(times[k] - data.opens);
  const first = data.opens === null ? times.length - 1 : times.reduce((best, time, k) => off(k) < off(best) ? k : best, 0);
  const state = { index: Math.max(0, first), story: 0, playing: false };
  const systemDark = matchMedia("(prefers-color-scheme: dark)");
  let chosenTheme = "auto";
  const theme = () => chosenTheme === "auto" ? (systemDark.matches ? "dark" : "light") : chosenTheme;
  const now = () => ({ time: times[state.index] ?? NaN, index: state.index, theme: theme(), story: state.story });

  function painted() {
    return new Promise(resolve => {
      chart.once("rendercomplete", resolve);
      chart.render();
    });
  }

  async function show(index) {
    state.index = Math.max(0, Math.min(times.length - 1, index));
    const then = now();
    get("slider").value = state.index;
    const hours = (then.time - times[0]) / 3600;
    const label = times.length ? `${group(then.time)}  (${hours < 0 ? "−" : "+"}${Math.abs(hours).toFixed(hours % 1 ? 1 : 0)} h)` : "";
    get("now").textContent = label;
    get("slider").setAttribute("aria-valuetext", label);
    await Promise.all(layers.filter(one => one.layer.getVisible()).map(one => one.update(then)));
    get("spoken").textContent = sentence(then.time);
    drawScale();
    for (const row of document.querySelectorAll("tr[data-time]")) row.classList.toggle("current", Number(row.dataset.time) === then.time);
    tellReadout();
    await painted();
  }

  // A sentence on what the map shows, from the tables with a time column.
  function sentence(time) {
    const parts = [];
    for (const leaf of data.leaves.filter(one => one.leaf === "table" && one.by_time && one.file)) {
      const table = files.table(leaf.file), when = table.header.indexOf(leaf.by_time);
      const row = table.rows.find(cells => epoch(cells[when]) === time);
      if (!row || leaf.where.fate !== undefined) continue;
      for (const [name, header, form] of leaf.columns.slice(1)) {
        const value = row[table.header.indexOf(name)];
        if (value && Number(value) !== 0) parts.push(`${header} ${written(value, form)}`);
      }
      break;
    }
    return parts.join("; ");
  }

  function drawScale() {
    const place = get("scale");
    place.replaceChildren();
    if (!raster || !raster.layer.getVisible() || !raster.scale().colours) return;
    const { colours, top } = raster.scale(), canvas = element("canvas", "", { width: 256, height: 1, "aria-hidden": "true" });
    const context = canvas.getContext("2d"), image = context.createImageData(256, 1);
    new Uint32Array(image.data.buffer).set(colours);
    context.putImageData(image, 0, 0);
    const ticks = element("div");
    for (const share of [0, 0.25, 0.5, 0.75, 1]) ticks.append(element("span", significant(100 * top * share * share, 2)));
    place.append(element("div", `${raster.title}, % per nmi²`), canvas, ticks);
  }

  // The position under the pointer or finger, or the centre of the map.
  let aimed = null;
  function tellReadout() {
    if (!aimed) return;
    const where = map.inverse(aimed), parts = [position(where)];
    const value = raster && raster.layer.getVisible() ? raster.at(where) : null;
    if (value) {
      parts.push(`${significant(100 * value.density, 2)} % per nmi²`);
      if (value.share !== null) parts.push(`on the edge of the ${(100 * value.share).toFixed(0)} % area`);
    }
    const datum = layers.find(one => one.leaf === "track" && one.layer.getVisible());
    const fix = datum && datum.fixes.find(one => one.time === times[state.index]);
    if (fix) {
      const { distance, bearing } = toward(fix.at, where);
      parts.push(`${(distance / NMI).toFixed(1)} nmi, ${String(Math.round(bearing) % 360).padStart(3, "0")}° from ${datum.title.toLowerCase()}`);
    }
    const under = chart.getFeaturesAtPixel(chart.getPixelFromCoordinate(aimed) || [0, 0], { hitTolerance: 5, layerFilter: layer => layers.some(one => one.layer === layer || one.nameplates === layer) });
    const names = [...new Set(under.map(feature => named(feature)).filter(Boolean))];
    get("readout").textContent = [parts.join("  ·  "), names.slice(0, 4).join("; ")].filter(Boolean).join("\n");
  }
  get("readout").style.whiteSpace = "pre-line";

  function owner(feature) {
    return layers.find(one => one.layer.getSource().hasFeature?.(feature));
  }

  function named(feature) {
    const one = owner(feature);
    if (!one) return "";
    if (one.leaf === "arrows") return one.told(feature).map(pair => pair.join(" ")).join();
    const level = feature.get("level");
    return [one.title, level === undefined ? feature.get("name") : `${Number((100 * level).toPrecision(6))} %`].filter(Boolean).join(": ");
  }

  function pick(pixel) {
    const under = chart.getFeaturesAtPixel(pixel, { hitTolerance: 6, layerFilter: layer => layers.some(one => one.layer === layer || one.nameplates === layer) });
    const place = get("picked");
    place.replaceChildren();
    const seen = new Set();
    for (const feature of under) {
      const told = owner(feature)?.told(feature) || [], name = named(feature);
      if (!told.length || seen.has(name)) continue;
      seen.add(name);
      const list = element("dl");
      for (const [term, words] of told) if (words !== "–") list.append(element("dt", term), element("dd", words));
      place.append(element("h3", name), list);
      if (seen.size === 4) break;
    }
    place.hidden = !seen.size;
  }

  chart.on("pointermove", event => {
    if (event.dragging) return;
    aimed = event.coordinate;
    target.classList.remove("aimed");
    tellReadout();
  });
  chart.on("click", event => {
    aimed = event.coordinate;
    tellReadout();
    pick(event.pixel);
  });
  target.addEventListener("keydown", event => {
    if (event.key !== "Enter" && event.key !== " ") return;
    event.preventDefault();
    aimed = view.getCenter();
    target.classList.add("aimed");
    tellReadout();
    pick(chart.getPixelFromCoordinate(aimed));
  });
  chart.on("moveend", () => {
    if (!target.classList.contains("aimed")) return;
    aimed = view.getCenter();
    tellReadout();
  });

  // The list of layers.
  for (const one of layers) {
    const label = element("label"), box = element("input", "", { type: "checkbox" });
    box.checked = one.shown;
    box.addEventListener("change", async () => {
      one.layer.setVisible(box.checked);
      if (box.checked) await one.update(now());
      drawScale();
    });
    label.append(box);
    if (one.look) label.append(element("canvas", "", { width: 68, height: 32, "data-look": one.look, "aria-hidden": "true" }));
    label.append(element("span", one.title));
    get("layers").append(label);
  }
  if (raster && raster.stories.length > 1) {
    raster.stories.forEach((name, k) => get("story").append(element("option", name, { value: k })));
    get("stories").hidden = false;
    get("story").addEventListener("change", () => {
      state.story = Number(get("story").value);
      show(state.index);
    });
  }

  // Time.
  get("slider").max = Math.max(0, times.length - 1);
  get("slider").addEventListener("input", () => show(Number(get("slider").value)));
  get("before").addEventListener("click", () => show(state.index - 1));
  get("after").addEventListener("click", () => show(state.index + 1));
  const PAUSE = 450; // [ms] that each output is shown during playback
  async function play() {
    while (state.playing) {
      const begun = performance.now();
      await show(state.index + 1 < times.length ? state.index + 1 : 0);
      await new Promise(resolve => setTimeout(resolve, Math.max(0, PAUSE - (performance.now() - begun))));
    }
  }
  get("play").addEventListener("click", () => {
    state.playing = !state.playing;
    get("play").textContent = state.playing ? "Pause" : "Play";
    get("play").setAttribute("aria-pressed", state.playing);
    if (state.playing) play();
  });
  if (times.length < 2) document.querySelector(".time").hidden = true;

  // Tables and texts.
  data.leaves.filter(leaf => leaf.leaf === "table" || leaf.leaf === "text").forEach(leaf => {
    const made = element("details");
    made.open = leaf.unfolded;
    made.append(element("summary", leaf.title));
    if (leaf.leaf === "text") made.append(element("pre", leaf.words || files.text(leaf.file), { tabindex: "0" }));
    else made.append(tabled(leaf, leaf.file ? files.table(leaf.file) : null, when => times.includes(when) && show(times.indexOf(when))).node);
    get("tables").append(made);
  });

  // Pictures.
  for (const [name, source] of Object.entries(data.pictures)) {
    const made = element("figure");
    made.append(element("figcaption", name), element("img", "", { src: `data:image/png;base64,${source}`, alt: name, loading: "lazy" }));
    get("pictures").append(made);
    get("pictures").hidden = false;
  }

  // Files.
  const size = bytes => bytes > 1e6 ? `${(bytes / 1e6).toFixed(1)} MB` : `${Math.max(1, Math.round(bytes / 1e3))} kB`;
  const TYPES = { geojson: "application/geo+json", csv: "text/csv", json: "application/json", kml: "application/vnd.google-earth.kml+xml", gpx: "application/gpx+xml" };
  for (const [name, { bytes, data: packed }] of Object.entries(data.files)) {
    const line = element("li"), button = element("button", `Save ${name}`, { type: "button" });
    button.addEventListener("click", async () => {
      const type = TYPES[name.split(".").pop()] || "text/plain";
      const link = element("a", "", { href: URL.createObjectURL(new Blob([await unpack.bytes(packed)], { type })), download: name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 1e4);
    });
    line.append(button, " ", element("small", size(bytes)));
    get("files").append(line);
  }
  for (const { name, bytes } of data.beside) {
    const line = element("li");
    line.append(element("a", name, { href: encodeURIComponent(name) }), " ", element("small", `${size(bytes)}, beside this page`));
    get("files").append(line);
  }

  // Colours, light or dark.
  function paint() {
    document.documentElement.dataset.theme = theme();
    const css = getComputedStyle(document.documentElement), colour = name => css.getPropertyValue(name).trim();
    theLand.setStyle(new ol.style.Style({ fill: new ol.style.Fill({ color: colour("--land") }), stroke: new ol.style.Stroke({ color: colour("--shore"), width: 0.8 }) }));
    grid.paint({ line: tinted(colour("--grid"), 0.6), ink: colour("--ink"), halo: colour("--halo") });
    for (const canvas of document.querySelectorAll("canvas[data-look]")) swatch(canvas, canvas.dataset.look, theme());
  }
  get("theme").addEventListener("click", () => {
    chosenTheme = { auto: "light", light: "dark", dark: "auto" }[chosenTheme];
    get("theme").textContent = `Colours: ${chosenTheme}`;
    get("theme").setAttribute("aria-label", `Colours: ${chosenTheme === "auto" ? "as the system's" : chosenTheme}`);
    paint();
    show(state.index);
  });
  systemDark.addEventListener("change", () => {
    paint();
    show(state.index);
  });

  // Initial view: all framed layers.
  const rings = unpack.land(JSON.parse(await packedLand), (west + east) / 2);
  theLand.getSource().addFeatures(rings.map(polygon => new ol.Feature(new ol.geom.Polygon(polygon.map(ring => ring.map(map.forward))))));
  paint();
  const framed = ol.extent.createEmpty();
  for (const one of layers.filter(layer => layer.frame)) for (const feature of one.every) ol.extent.extend(framed, feature.getGeometry().getExtent());
  if (!layers.some(one => one.frame && one.leaf === "shapes" && one.when === "at"))
    for (const lon of [west, (west + east) / 2, east]) for (const lat of [south, (south + north) / 2, north]) ol.extent.extendCoordinate(framed, map.forward([lon, lat]));
  view.fit(framed, { padding: [30, 30, 30, 30], minResolution: 5 });
  await show(state.index);
  Promise.all(layers.map(one => one.ready).filter(Boolean)).then(() => show(state.index));
  window.report = { show, state, times, layers, chart, map, view }; // for tests, and for scripts that use the page
  document.documentElement.dataset.ready = "yes";
})();
