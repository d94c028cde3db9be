// The form: fields in step with the text of the case, which stays the truth, and the first map.
import { complaint, opened, text, write } from "./editor.js";
import { all, ask, get, guarded, make, Rejected } from "./kit.js";
import * as sea from "./map.js";
import * as sources from "./sources.js";

const own = {
  form: /** @type {Form | null} */ (null),
  timer: 0,
  turn: /** @type {Promise<unknown>} */ (Promise.resolve()),
  refused: false, // whether the last change could not be written into the text
  scenario: 0,
  picking: "",
  asked: 0,
  fits: /** @type {string | null} */ (""), // the case that the map has gone to
  sketched: "", // the text of the first map that is shown
  sketching: /** @type {object | null} */ (null),
  draft: /** @type {Set<SourceName>} */ (new Set()), // sources that are being typed
  messages: /** @type {Message[]} */ ([]),
  more: /** @type {Message[]} */ ([]), // of places that only the page checks
  told: /** @type {((at: Point) => void) | null} */ (null), // takes the place that is clicked
  followers: /** @type {(() => Promise<void>)[]} */ ([]),
  sketches: /** @type {((told: Sketch) => void)[]} */ ([]), // who hears of a first map
};
const LIVE = 240; // [h] a forecast that ended so long ago or less is taken for one of today's
/** @type {DriftObject[]} */
let objects = [];

/** @type {(HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement)[]} */
const FIELDS = all("[data-field]");
/** @type {HTMLInputElement[]} */
const KNOWN = all("[name=known]");

/** @param {string} field @param {number} [scenario] */
const numbered = (field, scenario = own.scenario) => field.replace("scenario.*", own.form?.spill ? "spill" : `scenario.${scenario}`);
/** Whether the open case is of a spill. */
export const is_spill = () => Boolean(own.form?.spill);
/** @param {HTMLElement} element */
const name_of = (element) => numbered(element.dataset.field ?? "");
/** @param {HTMLElement} element */
const has_lines = (element) => element instanceof HTMLTextAreaElement;

/** @param {SourceName} what */
function send(what) {
  const value = sources.typed(what);
  if (!sources.whole(value)) {
    own.draft.add(what); // more is being typed
    return;
  }
  own.draft.delete(what);
  set(what, value.kind ? value : null);
}
sources.build(send);

// --- objects -------------------------------------------------------------------------------------------------------------
function list_objects() {
  const words = get("wanted").value.toLowerCase().split(/\s+/).filter(Boolean);
  const chosen = get("object").dataset.value ?? "";
  /** @param {DriftObject} one */
  const fits = (one) => words.every((word) => [one.name, one.description, ...one.words].some((part) => part.toLowerCase().includes(word)));
  const found = objects.filter(fits);
  const listed = found.some((one) => one.name === chosen) || !chosen ? found : [...objects.filter((one) => one.name === chosen), ...found];
  get("object").replaceChildren(...listed.map((one) => {
    const label = one.words.length ? `${one.words[0]}: ${one.description}` : one.description;
    return make("option", { value: one.name }, label);
  }));
  get("object").value = chosen;
  show_chosen();
  const now = objects.find((one) => one.name.toLowerCase() === chosen.toLowerCase());
  get("chosen").textContent = now ? `${now.name}: ${now.description}` : chosen;
}
/** Scroll the list of objects, and nothing else, to the one that is chosen. */
function show_chosen() {
  const list = get("object");
  const option = list.selectedOptions[0];
  if (!option) return;
  const [frame, its] = [list.getBoundingClientRect(), option.getBoundingClientRect()];
  if (its.top < frame.top || its.bottom > frame.bottom) list.scrollTop += its.top - frame.top - (frame.height - its.height) / 2;
}
get("wanted").addEventListener("input", list_objects);

// --- from the text to the form -------------------------------------------------------------------------------------------
const refresh = guarded(async () => {
  const words = text.value;
  const mine = ++own.asked;
  /** @type {Form} */
  let found;
  try {
    found = await ask("/api/form", { text: words });
  } catch (error) {
    if (!(error instanceof Rejected) || error.status !== 422) throw error;
    const line = Number(error.message.match(/line (\d+)/)?.[1]) || null;
    complain([{ message: error.message, field: null, line }]);
    get("form").classList.add("stale");
    return;
  }
  if (mine !== own.asked) return;
  own.form = found;
  fill(found);
  for (const follower of own.followers) await follower();
  if (mine !== own.asked) return;
  /** @type {{messages: Message[]}} */
  const told = await ask("/api/check", { text: words, name: opened.name });
  if (mine === own.asked) complain([...told.messages, ...own.more]);
});

/**
 * Show messages beside those of the check, from the next one on.
 * @param {Message[]} messages
 */
export function also_wrong(messages) {
  own.more = messages;
}

/**
 * Call something whenever the text has changed and can be read.
 * @param {() => Promise<void>} follower
 */
export function follow(follower) {
  own.followers.push(follower);
}

/**
 * Call something whenever a first map is shown.
 * @param {(told: Sketch) => void} follower
 */
export function follow_sketch(follower) {
  own.sketches.push(follower);
}

/** @param {Form} form */
function fill({ fields, unknown, scenarios }) {
  own.scenario = Math.min(own.scenario, Math.max(0, scenarios - 1));
  get("several").hidden = scenarios < 2;
  get("scenario").replaceChildren(...Array.from({ length: scenarios }, (_, k) => {
    return make("option", { value: k }, String(fields[`scenario.${k}.name`]?.value ?? k + 1));
  }));
  get("scenario").value = String(own.scenario);
  for (const element of FIELDS) fill_field(element, fields[name_of(element)] ?? { value: null });
  const start = fields.start?.read;
  get("picker").value = start ? String(start).slice(0, 16) : "";
  show_end(start, fields.duration?.read);
  for (const what of sources.SOURCES) fill_source(what, fields[what]);
  /** @param {string} key */
  const part = (key) => fields[numbered(`scenario.*.${key}`)] ?? {};
  const has = ["position.at", "trackline.waypoints", "area.polygon"].find((key) => part(key).value || part(key).in_text);
  if (has) show_known(has.split(".")[0]);
  get("unknown").textContent = unknown.length ? `The text also sets ${unknown.map(in_words).join("; ")}.` : "";
  show_place({
    at: /** @type {Point | undefined} */ (part("position.at").read),
    error: /** @type {number | undefined} */ (part("position.error").read),
    line: /** @type {Point[] | undefined} */ (part("trackline.waypoints").read),
    polygon: /** @type {Point[] | undefined} */ (part("area.polygon").read),
  });
  get("headline").classList.toggle("old", Boolean(own.sketched) && own.sketched !== text.value);
}

/** What keys that no field shows set, by their first part. @type {Record<string, string>} */
const ELSEWHERE = {
  output: "how often maps are made, and of which areas",
  uncertainty: "the errors of wind and current",
  clock: "the time step",
  domain: "the region that is computed",
  coast: "the shoreline, and what happens on it",
  stokes: "the drift by waves",
  leeway: "how the object drifts in the wind",
  family: "families of scenarios",
  drifter: "drifting buoys",
  report: "winds and currents reported on scene",
  expect: "what the run is compared with",
};

/** @param {string} key that no field shows */
function in_words(key) {
  const told = ELSEWHERE[key.split(".")[0]];
  return told ? `${told} (${key})` : key;
}

/**
 * Say when the forecast ends, and warn if that was in the last days: the object is sought now.
 * @param {unknown} start
 * @param {unknown} duration [s]
 */
function show_end(start, duration) {
  const end = epoch(String(start)) + Number(duration);
  const ago = (Date.now() / 1000 - end) / 3600;
  const live = ago > 0 && ago < LIVE;
  get("ends").className = live ? "wrong" : "soft";
  const late = live ? `, ${ago.toFixed(ago < 10 ? 1 : 0)} h ago: make it longer to see where the object is now` : "";
  get("ends").textContent = start && duration && Number.isFinite(end) ? `to ${group(end)}${late}` : "";
}

/**
 * @param {HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement} element
 * @param {Field} field
 */
function fill_field(element, field) {
  element.disabled = Boolean(field.in_text);
  const object = element.id === "object";
  if (element === document.activeElement && !element.disabled && !has_lines(element) && !object) return;
  const value = field.in_text ? "set in the text" : field.value;
  if (!object) {
    element.value = Array.isArray(value) ? value.join("\n") : String(value ?? "");
    return;
  }
  element.dataset.value = field.in_text ? "" : String(value ?? "");
  list_objects();
  if (field.in_text) get("chosen").textContent = "set in the text";
}

/**
 * @param {SourceName} what
 * @param {Field} field
 */
function fill_source(what, field) {
  const value = /** @type {Source | null} */ (field.value ?? null);
  sources.kind_of(what).disabled = Boolean(field.in_text);
  if (field.in_text) sources.in_text(what);
  else if (!own.draft.has(what) && sources.canonical(value) !== sources.canonical(sources.typed(what))) {
    keep_focus(() => sources.rows(what, value));
  }
}

/**
 * Show on the map where the object went adrift; go there when a case is opened.
 * @param {Place} place
 */
function show_place(place) {
  sea.place(place);
  const points = place.at ? [place.at] : place.line ?? place.polygon ?? [];
  if (!points.length || own.fits === opened.name) return;
  own.fits = opened.name;
  const reach = (place.error || 2000) / 20000;
  sea.look_at(points.flatMap(([lon, lat]) => [[lon - 2 * reach, lat - reach], [lon + 2 * reach, lat + reach]]));
}

/**
 * Redraw inputs, and give the focus back to the one that had it.
 * @param {() => void} work
 */
function keep_focus(work) {
  const label = document.activeElement?.getAttribute("aria-label");
  work();
  if (label && document.activeElement === document.body) all(`#form [aria-label="${CSS.escape(label)}"]`)[0]?.focus();
}

/** @param {string} which what is known of the place: position, trackline, area or track */
export function show_known(which) {
  for (const radio of KNOWN) radio.checked = radio.value === which;
  for (const part of all("[data-known]")) part.hidden = part.dataset.known !== which;
}

/** How a message begins: with the place of its key in the text. */
const PLACE = /^(scenario "[^"]*"|[\w.]+ ("[^"]*"|\d+)|spill)[\w. ]*: /;

/**
 * Return the elements of the form that show a field or a row.
 * @param {string | null} field
 */
function elements_of(field) {
  const source = sources.SOURCES.find((one) => one === field);
  if (source) return [/** @type {HTMLElement} */ (sources.kind_of(source))];
  /** @param {HTMLElement} one */
  const is_its = (one) => [name_of(one), one.dataset.own, one.parentElement?.dataset.row].includes(field ?? "no field");
  return [...FIELDS, ...all("#form [data-own], #form [data-row] > summary")].filter(is_its);
}

/**
 * Return a mistake of the open case with the name of its field in the form in place of its keys.
 * @param {string} line of a job, which begins with the name of the file
 */
export function in_words_of_form(line) {
  const told = own.messages.find(({ message, field }) => field && line.endsWith(message));
  const element = told && elements_of(told.field)[0];
  const label = element && document.querySelector(`label[for="${CSS.escape(element.id)}"]`)?.textContent;
  return told && label ? `"${label}" in the form: ${told.message.replace(PLACE, "").replace(/^[\w.]+: /, "")}` : line;
}

/**
 * Show each message beside its field; the others in a list.
 * @param {Message[]} messages
 */
function complain(messages) {
  own.messages = messages;
  for (const old of all("#form .beside")) old.remove();
  for (const element of all("#form [aria-invalid]")) {
    element.removeAttribute("aria-invalid");
    element.removeAttribute("aria-describedby");
  }
  /** @type {HTMLElement[]} */
  const others = [];
  messages.forEach(({ message, field, line }, k) => {
    const element = elements_of(field).find((one) => !one.closest("[hidden]"));
    const at = element?.closest("p, summary");
    if (!element || !at) {
      others.push(complaint(line ? `${message} (line ${line})` : message));
      return;
    }
    const id = `message-${k}`;
    element.setAttribute("aria-invalid", "true");
    element.setAttribute("aria-describedby", id);
    element.closest("details")?.setAttribute("open", "");
    at.after(make("p", { class: "wrong beside", id }, message.replace(PLACE, "")));
  });
  get("messages").replaceChildren(...others);
}

// --- from the form to the text -------------------------------------------------------------------------------------------
/**
 * Write a field into the text, and those that it needs.
 * @param {string} field as data-field names it: a change before it may yet turn a search into a spill
 * @param {FieldValue} value
 */
function set(field, value) {
  const scenario = own.scenario;
  return work_on_text(field, () => changed_text(needed(field, value, scenario)));
}

/**
 * Return the change of a field, and of those that it needs.
 * @param {string} field
 * @param {FieldValue} value
 * @param {number} scenario
 */
function needed(field, value, scenario) {
  const changes = [{ field: numbered(field, scenario), value }];
  /** @param {string} other @param {string} first */
  const also = (other, first) => {
    const name = numbered(other, scenario);
    if (!own.form?.fields[name]?.value) changes.push({ field: name, value: first });
  };
  if (field.endsWith("position.at")) also("scenario.*.position.error", "1 nmi");
  if (field.endsWith("trackline.waypoints") && value) {
    also("scenario.*.trackline.speed", "6 kn");
    also("scenario.*.trackline.cross_track", "1 nmi");
  }
  return changes;
}

/**
 * Return the text with other fields.
 * @param {Change[]} changes
 */
async function changed_text(changes) {
  /** @type {{text: string}} */
  const told = await ask("/api/form/set", { text: text.value, changes });
  return told.text;
}

/**
 * Change fields of the text.
 * @param {Change[]} changes
 */
export function change(changes) {
  return work_on_text(changes[0].field, () => changed_text(changes));
}

/**
 * Take over a new text of the case, after all changes before it.
 * @param {string | null} field that a mistake is about
 * @param {() => Promise<string>} work returns the text
 */
export function work_on_text(field, work) {
  own.turn = own.turn.then(guarded(async () => {
    own.refused = true;
    try {
      write(await work());
      own.refused = false;
    } catch (error) {
      if (!(error instanceof Rejected) || ![400, 422].includes(error.status)) throw error;
      complain([{ message: error.message, field: field && numbered(field), line: null }]);
      return;
    }
    await refresh();
  }));
  return own.turn;
}

/**
 * Wait until the text has all that was typed into the form; return false if a field could not be written.
 * @returns {Promise<boolean>}
 */
export async function settled() {
  const typed = document.activeElement;
  if ((typed instanceof HTMLInputElement || typed instanceof HTMLTextAreaElement) && typed.form === get("form")) { // leaving it writes what it has
    typed.blur();
    typed.focus({ preventScroll: true });
  }
  await own.turn;
  return !own.refused;
}

/** @param {string} words @returns {string[]} */
const lines_of = (words) => words.split("\n").map((one) => one.trim()).filter(Boolean);

for (const element of FIELDS) {
  element.addEventListener("change", () => {
    const words = element.value.trim();
    const value = has_lines(element) ? lines_of(words) : words;
    set(element.dataset.field ?? "", words === "" ? null : value);
  });
}
get("picker").addEventListener("change", () => {
  if (get("picker").value) set("start", group(epoch(`${get("picker").value}Z`)));
});
get("scenario").addEventListener("change", () => {
  own.scenario = Number(get("scenario").value);
  own.fits = "";
  refresh();
});
for (const radio of KNOWN) {
  radio.addEventListener("change", () => {
    show_known(radio.value);
    pick("");
  });
}
get("form").addEventListener("submit", (event) => event.preventDefault());
text.addEventListener("input", () => {
  own.refused = false; // the text counts now
  own.draft.clear();
  clearTimeout(own.timer);
  own.timer = setTimeout(refresh, 250);
});

// --- places from the map -------------------------------------------------------------------------------------------------
/** @param {string} which what a click on the map gives: position, trackline or area; "": nothing */
function pick(which) {
  own.picking = own.picking === which ? "" : which;
  if (!own.picking) own.told = null;
  for (const one of all("[data-pick]")) one.setAttribute("aria-pressed", String(one.dataset.pick === own.picking));
  sea.pick(own.picking ? own.told ?? take : null);
}

/**
 * Have the user click a place for a field, or several until the button is pressed again.
 * @param {string} field
 * @param {(at: string) => void} told
 * @param {boolean} several
 */
export function pick_for(field, told, several) {
  own.told = (at) => {
    if (!several) pick("");
    told(spelled(at));
  };
  pick(field);
  if (own.picking) get("map").focus({ preventScroll: false });
}

/** @param {Point} at */
export const spelled = (at) => position(at).replaceAll("-", " ");

/** @param {Point} at where the user has clicked */
function take(at) {
  if (own.picking === "position") {
    set("scenario.*.position.at", spelled(at));
    pick("");
    return;
  }
  const field = own.picking === "area" ? "scenario.*.area.polygon" : "scenario.*.trackline.waypoints";
  const element = FIELDS.find((one) => one.dataset.field === field);
  if (!element) return;
  element.value = [...lines_of(element.value), spelled(at)].join("\n");
  set(field, element.value.split("\n"));
}

for (const one of all("[data-pick]")) {
  one.addEventListener("click", () => {
    own.told = null;
    pick(one.dataset.pick ?? "");
    if (own.picking) get("map").focus({ preventScroll: false });
  });
}
sea.dragging({
  position: (at) => set("scenario.*.position.at", spelled(at)),
  error: (metres) => set("scenario.*.position.error", `${Number((metres / NMI).toPrecision(2))} nmi`),
});

// --- the first map -------------------------------------------------------------------------------------------------------
/** @type {Record<string, string>} */
const LOOKS_OF = { adrift: "sample", ashore: "ashore" };

/** Make a first map of the text, and show it; return what is shown, or null. */
export const first_map = guarded(async () => {
  if (!(await settled())) return null;
  const words = text.value;
  const begun = performance.now();
  const mine = (own.sketching = {});
  get("headline").textContent = "Making a first map ...";
  get("map").scrollIntoView({ block: "nearest" }); // on a phone it is above
  get("warned").replaceChildren();
  get("changed").textContent = "";
  try {
    /** @type {Sketch} */
    const told = await ask("/api/sketch", { text: words, name: opened.name });
    if (own.sketching !== mine) return null;
    own.sketched = words;
    get("headline").classList.toggle("old", words !== text.value);
    const shown = { ...told, looks: looks_of(told.statuses) };
    sea.show(shown);
    for (const follower of own.sketches) follower(told);
    const took = ((performance.now() - begun) / 1000).toFixed(1);
    get("headline").textContent = `First map, ${told.number.toLocaleString("en")} particles: ${told.words} (${took} s)`;
    get("headline").dataset.seconds = took;
    get("warned").replaceChildren(...told.warnings.map((one) => make("li", {}, one)));
    return shown;
  } catch (error) {
    if (own.sketching !== mine) return null;
    if (!(error instanceof Error)) throw error;
    const mistaken = error instanceof Rejected && error.status === 422;
    get("headline").textContent = mistaken ? `No first map yet: ${error.message}` : error.message;
    return null;
  }
});
get("first").addEventListener("click", () => first_map());

/** @param {string[]} statuses names, in order of their numbers */
export const looks_of = (statuses) => statuses.map((one) => LOOKS_OF[one]);

/**
 * Show the areas of a result.
 * @param {string} title
 * @param {Areas} areas
 * @param {Partial<Shown>} [more]
 * @param {boolean} [keep] the view and the time stay
 */
export function show_areas(title, areas, more = {}, keep = false) {
  own.sketched = "";
  own.sketching = null; // a first map that is still being made comes too late
  get("changed").textContent = "";
  get("headline").classList.remove("old");
  get("headline").textContent = `Areas of ${title}`;
  get("warned").replaceChildren();
  sea.show({ areas, ...more }, keep);
}

/** Fill the form from a text that was just opened in the editor. */
export const begin = guarded(async () => {
  Object.assign(own, { scenario: 0, fits: "", form: null, refused: false, sketched: "", sketching: null, more: [] });
  own.draft.clear();
  get("wanted").value = "";
  for (const what of sources.SOURCES) sources.rows(what, null);
  show_known("position");
  pick("");
  sea.clear();
  for (const id of /** @type {const} */ (["headline", "changed", "readout"])) get(id).textContent = "";
  get("warned").replaceChildren();
  await sources.list_files();
  await refresh();
});

for (const one of all("[data-tab]")) {
  one.addEventListener("click", () => {
    complain(own.messages); // beside what is shown now
    show_chosen();
  });
}

guarded(async () => {
  /** @type {{objects: DriftObject[]}} */
  const told = await ask("/api/objects");
  objects = told.objects;
  list_objects();
})();
