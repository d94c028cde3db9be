"use strict";
// The form: fields in step with the text of the case, which stays the truth, and the first map.
(() => {
  const get = (id) => document.getElementById(id);
  const { ask, guarded, make, state, text } = desk;
  const own = { form: null, timer: 0, turn: Promise.resolve(), scenario: 0, picking: "", asked: 0, known: "", fits: "", sketched: "", draft: new Set() };
  const SOURCES = ["wind", "current"];
  const FIELDS = [...document.querySelectorAll("[data-field]")];
  const name = (field) => field.replace("*", own.scenario);
  const lines = (element) => element.tagName === "TEXTAREA";

  // --- wind and current --------------------------------------------------------------------------------------------------
  for (const box of document.querySelectorAll("[data-source]")) {
    const what = box.dataset.source, direction = box.dataset.direction, words = what === "wind" ? "Wind" : "Current";
    const kind = make("select", { id: `${what}-kind` });
    for (const [value, label] of [["", "none yet"], ["constant", "as reported, the same all the time"], ["table", "as reported, by time"], ["files", "files of this folder"]])
      kind.append(make("option", { value }, label));
    box.append(make("p", {}, make("label", { for: `${what}-kind` }, words), " ", kind), make("div", { "data-rows": what }));
    kind.addEventListener("change", () => { rows(what, direction, start_of(kind.value)); send(what); });
  }

  function start_of(kind) {
    if (kind === "table") return { kind, rows: [{}, {}] };
    return kind === "files" ? { kind, files: [] } : { kind };
  }

  function box_of(label, value, size, options = {}) {
    const input = make("input", { size, "aria-label": label, ...options });
    input.value = value ?? "";
    return input;
  }

  // The inputs of a source: value as the server tells it.
  function rows(what, direction, value) {
    const place = document.querySelector(`[data-rows="${what}"]`), words = what === "wind" ? "Wind" : "Current";
    const rate = what === "wind" ? "15 kn" : "0.5 kn";
    get(`${what}-kind`).value = value?.kind ?? "";
    place.replaceChildren();
    if (!value?.kind) return;
    if (value.kind === "files") {
      const list = own.files ?? [];
      const chosen = new Set(value.files);
      for (const file of new Set([...list, ...value.files])) {
        const tick = make("input", { type: "checkbox", value: file, checked: chosen.has(file) });
        const covers = make("small", {});
        tell_cover(file, covers);
        tick.addEventListener("change", () => send(what));
        place.append(make("p", {}, make("label", {}, tick, ` ${file} `), covers));
      }
      if (!place.firstChild) place.append(make("p", { class: "soft" }, "No netCDF or GRIB file lies in this folder."));
      return;
    }
    const table = value.kind === "table" ? value.rows : [value];
    table.forEach((row, k) => {
      const line = make("p", { "data-row": k });
      const several = value.kind === "table" ? ` ${k + 1}` : "";
      if (value.kind === "table") line.append(box_of(`${words} time${several}`, row.time, 13, { "data-key": "time", placeholder: k ? "+24 h" : "+0 h" }), " ");
      line.append(box_of(`${words} speed${several}`, row.speed, 6, { "data-key": "speed", placeholder: rate }), ` ${direction} `,
        box_of(`${words} ${direction}${several}, degrees true`, row[direction], 4, { "data-key": direction, placeholder: "240", inputmode: "numeric" }), "°");
      if (value.kind === "table" && table.length > 1) {
        line.append(" ", make("button", { type: "button", "aria-label": `Remove row ${k + 1} of the ${what}`, onclick: () => { line.remove(); send(what); } }, "−"));
      }
      for (const input of line.querySelectorAll("input")) input.addEventListener("change", () => send(what));
      place.append(line);
    });
    if (value.kind === "table") {
      place.append(make("p", {}, make("button", { type: "button", onclick: () => rows(what, direction, { kind: "table", rows: [...typed(what).rows, {}] }) }, "One more time")));
    }
  }

  // What is typed of a source; null: not whole yet.
  function typed(what) {
    const kind = get(`${what}-kind`).value, place = document.querySelector(`[data-rows="${what}"]`);
    if (!kind) return { kind };
    if (kind === "files") return { kind, files: [...place.querySelectorAll("input:checked")].map((one) => one.value) };
    const found = [...place.querySelectorAll("[data-row]")].map((line) => Object.fromEntries([...line.querySelectorAll("[data-key]")].map((input) => {
      const words = input.value.trim(), angle = ["from", "toward"].includes(input.dataset.key);
      return [input.dataset.key, angle && words !== "" && Number.isFinite(Number(words)) ? Number(words) : words];
    })));
    return kind === "constant" ? { kind, ...found[0] } : { kind, rows: found };
  }

  function send(what) {
    const value = typed(what);
    const parts = value.kind === "files" ? value.files : value.kind === "table" ? value.rows.flatMap(Object.values) : Object.values(value);
    if (value.kind && (!parts.length || parts.some((one) => one === ""))) return own.draft.add(what); // more is being typed
    own.draft.delete(what);
    if (!value.kind) return set(what, null);
    set(what, value);
  }

  const covers = new Map();
  async function tell_cover(file, place) {
    if (!covers.has(file)) {
      covers.set(file, ask("/api/forcing", { file }).then(({ sources }) => sources.map(({ quantity, box, times }) => {
        const edge = (value) => Number(value.toFixed(1));
        return `${quantity}, ${times.map((one) => group(epoch(one))).join(" to ") || "no time"}, ${edge(box[1])} to ${edge(box[3])} N, ${edge(box[0])} to ${edge(box[2])} E`;
      }).join("; ") || "no wind and no current", (error) => error.message));
    }
    place.textContent = await covers.get(file);
  }

  // --- objects -----------------------------------------------------------------------------------------------------------
  let objects = [];
  function list_objects() {
    const words = get("wanted").value.toLowerCase().split(/\s+/).filter(Boolean), chosen = get("object").dataset.value ?? "";
    const fits = (one) => words.every((word) => [one.name, one.description, ...one.words].some((part) => part.toLowerCase().includes(word)));
    const found = objects.filter(fits);
    const listed = found.some((one) => one.name === chosen) || !chosen ? found : [...objects.filter((one) => one.name === chosen), ...found];
    get("object").replaceChildren(...listed.map((one) => make("option", { value: one.name }, one.words.length ? `${one.words[0]}: ${one.description}` : one.description)));
    get("object").value = chosen;
    const now = objects.find((one) => one.name.toLowerCase() === chosen.toLowerCase());
    get("chosen").textContent = now ? `${now.name}: ${now.description}` : chosen;
  }
  get("wanted").addEventListener("input", list_objects);

  // --- from the text to the form -----------------------------------------------------------------------------------------
  const refresh = guarded(async () => {
    const words = text.value, mine = ++own.asked;
    let found;
    try {
      found = await ask("/api/form", { text: words });
    } catch (error) {
      if (error.status !== 422) throw error;
      complain([{ message: error.message, field: null, line: Number(error.message.match(/line (\d+)/)?.[1]) || null }]);
      get("form").classList.add("stale");
      return;
    }
    if (mine !== own.asked) return;
    own.form = found;
    fill();
    const told = await ask("/api/check", { text: words, name: state.name });
    if (mine === own.asked) complain(told.messages);
  });

  function fill() {
    const { fields, unknown, scenarios } = own.form;
    own.scenario = Math.min(own.scenario, Math.max(0, scenarios - 1));
    get("several").hidden = scenarios < 2;
    get("scenario").replaceChildren(...Array.from({ length: scenarios }, (_, k) => make("option", { value: k }, fields[`scenario.${k}.name`]?.value ?? `${k + 1}`)));
    get("scenario").value = own.scenario;
    for (const element of FIELDS) {
      const field = fields[name(element.dataset.field)] ?? { value: null };
      element.disabled = Boolean(field.in_text);
      if (element === document.activeElement && !element.disabled && lines(element) === false && element.id !== "object") continue;
      const value = field.in_text ? "set in the text" : field.value;
      if (element.id === "object") {
        element.dataset.value = field.in_text ? "" : value ?? "";
        list_objects();
        if (field.in_text) get("chosen").textContent = "set in the text";
      } else element.value = Array.isArray(value) ? value.join("\n") : value ?? "";
    }
    const start = fields.start?.read;
    get("picker").value = start ? start.slice(0, 16) : "";
    for (const what of SOURCES) {
      const box = document.querySelector(`[data-source="${what}"]`), field = fields[what];
      get(`${what}-kind`).disabled = Boolean(field.in_text);
      if (field.in_text) document.querySelector(`[data-rows="${what}"]`).replaceChildren(make("p", { class: "soft" }, "Set in the text."));
      else if (!own.draft.has(what) && canonical(field.value) !== canonical(typed(what))) keep_focus(() => rows(what, box.dataset.direction, field.value));
    }
    const part = (key) => fields[`scenario.${own.scenario}.${key}`] ?? {};
    const has = ["position.at", "trackline.waypoints", "area.polygon"].find((key) => part(key).value || part(key).in_text);
    if (has) known(has.split(".")[0]);
    get("unknown").textContent = unknown.length ? `Also set, in the text: ${unknown.join(", ")}.` : "";
    const read = (key) => part(key).read;
    const place = { at: read("position.at"), error: read("position.error"), line: read("trackline.waypoints"), polygon: read("area.polygon") };
    sea.place(place);
    const points = place.at ? [place.at] : place.line ?? place.polygon ?? [];
    if (points.length && own.fits !== state.name) {
      own.fits = state.name;
      const reach = (place.error || 2000) / 20000;
      sea.look_at(points.flatMap(([lon, lat]) => [[lon - 2 * reach, lat - reach], [lon + 2 * reach, lat + reach]]));
    }
    get("headline").classList.toggle("old", Boolean(own.sketched) && own.sketched !== text.value);
  }

  // A source as text that does not depend on the order of its keys.
  function canonical(value) {
    const sorted = (one) => Object.entries(one).sort().join(";");
    return value?.kind ? JSON.stringify([sorted({ ...value, rows: "", files: "" }), value.files, value.rows?.map(sorted)]) : "";
  }

  // Redraws inputs, and gives the focus back to the one that had it.
  function keep_focus(work) {
    const label = document.activeElement?.getAttribute("aria-label");
    work();
    if (label && document.activeElement === document.body) document.querySelector(`#form [aria-label="${CSS.escape(label)}"]`)?.focus();
  }

  function known(which) {
    own.known = which;
    for (const radio of document.querySelectorAll("[name=known]")) radio.checked = radio.value === which;
    for (const part of document.querySelectorAll("[data-known]")) part.hidden = part.dataset.known !== which;
  }

  // Each message beside its field; the others in a list.
  function complain(messages) {
    for (const old of document.querySelectorAll("#form .beside")) old.remove();
    for (const element of document.querySelectorAll("#form [aria-invalid]")) {
      element.removeAttribute("aria-invalid");
      element.removeAttribute("aria-describedby");
    }
    const others = [];
    messages.forEach(({ message, field, line }, k) => {
      const element = field && (SOURCES.includes(field) ? get(`${field}-kind`)
        : FIELDS.find((one) => name(one.dataset.field) === field && !one.closest("[hidden]")));
      const at = element?.closest("p");
      if (!at) return others.push(line ? desk.complaint(`${message} (line ${line})`) : desk.complaint(message));
      const id = `message-${k}`;
      element.setAttribute("aria-invalid", "true");
      element.setAttribute("aria-describedby", id);
      at.after(make("p", { class: "wrong beside", id }, message.replace(/^(scenario "[^"]*"|\w+ "[^"]*")[\w. ]*: /, "")));
    });
    get("messages").replaceChildren(...others);
  }

  // --- from the form to the text -----------------------------------------------------------------------------------------
  function set(field, value) {
    const changes = [{ field, value }];
    if (field.endsWith("position.at") && !own.form?.fields[name("scenario.*.position.error")]?.value) changes.push({ field: name("scenario.*.position.error"), value: "1 nmi" });
    if (field.endsWith("trackline.waypoints") && value) {
      for (const [key, first] of [["speed", "6 kn"], ["cross_track", "1 nmi"]]) {
        if (!own.form?.fields[name(`scenario.*.trackline.${key}`)]?.value) changes.push({ field: name(`scenario.*.trackline.${key}`), value: first });
      }
    }
    own.turn = own.turn.then(guarded(async () => {
      try {
        const told = await ask("/api/form/set", { text: text.value, changes });
        desk.write(told.text);
      } catch (error) {
        if (error.status !== 422 && error.status !== 400) throw error;
        complain([{ message: error.message, field, line: null }]);
        return;
      }
      await refresh();
    }));
    return own.turn;
  }

  for (const element of FIELDS) element.addEventListener("change", () => {
    const words = element.value.trim();
    set(name(element.dataset.field), words === "" ? null : lines(element) ? words.split("\n").map((one) => one.trim()).filter(Boolean) : words);
  });
  get("picker").addEventListener("change", () => get("picker").value && set("start", group(epoch(`${get("picker").value}Z`))));
  get("scenario").addEventListener("change", () => { own.scenario = Number(get("scenario").value); own.fits = ""; refresh(); });
  for (const radio of document.querySelectorAll("[name=known]")) radio.addEventListener("change", () => { known(radio.value); pick(""); });
  get("form").addEventListener("submit", (event) => event.preventDefault());
  text.addEventListener("input", () => { own.draft.clear(); clearTimeout(own.timer); own.timer = setTimeout(refresh, 250); });

  function pick(which) {
    own.picking = own.picking === which ? "" : which;
    for (const button of document.querySelectorAll("[data-pick]")) button.setAttribute("aria-pressed", button.dataset.pick === own.picking);
    sea.pick(Boolean(own.picking));
  }
  for (const button of document.querySelectorAll("[data-pick]")) button.addEventListener("click", () => {
    pick(button.dataset.pick);
    if (own.picking) get("map").focus({ preventScroll: false });
  });
  const spelled = (at) => position(at).replaceAll("-", " ");
  document.addEventListener("picked", ({ detail: at }) => {
    if (own.picking === "position") {
      set(name("scenario.*.position.at"), spelled(at));
      return pick("");
    }
    const field = name(own.picking === "area" ? "scenario.*.area.polygon" : "scenario.*.trackline.waypoints");
    const element = FIELDS.find((one) => name(one.dataset.field) === field);
    element.value = [...element.value.split("\n").filter((one) => one.trim()), spelled(at)].join("\n");
    set(field, element.value.split("\n"));
  });
  document.addEventListener("dragged", ({ detail: { at, error } }) => {
    if (at) set(name("scenario.*.position.at"), spelled(at));
    else set(name("scenario.*.position.error"), `${Number((error / NMI).toPrecision(2))} nmi`);
  });

  // --- the first map -----------------------------------------------------------------------------------------------------
  const LOOKS_OF = { adrift: "sample", ashore: "ashore" };
  get("first").addEventListener("click", guarded(async () => {
    await own.turn;
    const words = text.value, begun = performance.now(), mine = (own.sketching = {});
    get("headline").textContent = "Making a first map ...";
    get("map").scrollIntoView({ block: "nearest" }); // on a phone it is above
    get("warned").replaceChildren();
    try {
      const told = await ask("/api/sketch", { text: words, name: state.name });
      if (own.sketching !== mine) return;
      told.looks = told.statuses.map((one) => LOOKS_OF[one]);
      own.sketched = words;
      get("headline").classList.toggle("old", words !== text.value);
      sea.show(told);
      get("headline").textContent = `First map, of few particles: ${told.words} (${((performance.now() - begun) / 1000).toFixed(1)} s)`;
      get("warned").replaceChildren(...told.warnings.map((one) => make("li", {}, one)));
    } catch (error) {
      if (own.sketching !== mine) return;
      get("headline").textContent = error.status === 422 ? `No first map yet: ${error.message}` : error.message;
    }
  }));
  document.addEventListener("areas", ({ detail }) => {
    own.sketched = "";
    get("headline").classList.remove("old");
    get("headline").textContent = `Areas of ${detail.title}`;
    get("warned").replaceChildren();
    sea.show(detail);
  });

  document.addEventListener("laid", guarded(async () => {
    Object.assign(own, { scenario: 0, fits: "", form: null, sketched: "", sketching: null });
    own.draft.clear();
    for (const box of document.querySelectorAll("[data-source]")) rows(box.dataset.source, box.dataset.direction, null);
    known("position");
    pick("");
    sea.clear();
    get("headline").textContent = "";
    get("warned").replaceChildren();
    own.files = (await ask("/api/forcing", { file: null })).files;
    await refresh();
  }));
  guarded(async () => { objects = (await ask("/api/objects")).objects; list_objects(); })();
  sea.paint();
})();
