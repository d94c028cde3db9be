// A plan on the map: its sub-areas, which can be moved and turned; the server computes the POS of each move.
import { layer_of, on_map, search_shapes, shape } from "./drawn.js";
import { opened, tab, text } from "./editor.js";
import * as form from "./form.js";
import { ask, button, file_of, get, guarded, make } from "./kit.js";
import * as sea from "./map.js";

const STEP = 0.2 * NMI; // [m] of an arrow key; five times that with Shift
const TURN = 5; // [deg] of a key
const own = {
  run: "",
  key: "",
  plan: /** @type {Planned | null} */ (null), // as its files state it
  now: /** @type {MovedPlan | null} */ (null), // as the server has computed it last
  moves: /** @type {Record<string, Move>} */ ({}),
  chosen: "", // sub-area that keys and the handle move
  busy: false,
  again: false,
  shown: 0, // counts what was opened, so that a late answer is dropped
};
const drawn = layer_of(40);
const handles = layer_of(45);

/** @param {number} share */
const percent = (share) => `${(100 * share).toFixed(1)} %`;

// --- opening a plan ------------------------------------------------------------------------------------------------------
/**
 * Show a plan on the map.
 * @param {string} run
 * @param {string} key of its files
 * @param {string[]} files
 */
export const open_plan = guarded(async (/** @type {string} */ run, /** @type {string} */ key, /** @type {string[]} */ files) => {
  const mine = ++own.shown;
  /** @type {Planned} */
  const plan = await ask("/api/plan", { run });
  if (mine !== own.shown) return;
  Object.assign(own, { run, key, plan, now: null, moves: {}, chosen: plan.areas[0]?.name ?? "" });
  get("plan-box").hidden = false;
  get("plan-title").textContent = `Plan on the map: ${run}`;
  get("plan-files").replaceChildren(...links(files));
  build(plan);
  draw();
  tab("search");
  sea.look_at(plan.areas.flatMap((area) => area.outline ?? []));
  show_time();
  get("map").scrollIntoView({ block: "nearest" }); // on a phone it is above
  get("plan-said").textContent = "The particles of the plan are being followed, so that a move can be computed ...";
  await compute();
});

/** Show no plan. */
export function close_plan() {
  own.shown++;
  Object.assign(own, { run: "", plan: null, now: null, moves: {} });
  drawn.source.clear(true);
  handles.source.clear(true);
  get("plan-box").hidden = true;
}

/** @param {string[]} files of the run */
function links(files) {
  const wanted = files.filter((name) => /^(plan-[A-Z]+-\d+(-\d+)?\.png|plan\.(txt|gpx)|suspend\.(txt|png))$/.test(name));
  /** @param {string} name */
  const words = (name) => name === "plan.txt" ? "action plan" : name === "plan.gpx" ? "routes (GPX)"
    : name.startsWith("suspend") ? `decision to suspend (${name.slice(8)})` : `sheet ${name.slice(5, -4)}`;
  return wanted.map((name) => make("li", {}, make("a", { href: file_of(own.run, own.key, name), target: "_blank", rel: "noopener noreferrer" }, words(name))));
}

// --- the list of sub-areas -----------------------------------------------------------------------------------------------
/** @type {Map<string, {pos: HTMLElement, notes: HTMLElement, mover: HTMLButtonElement, undo: HTMLButtonElement}>} */
const rows = new Map();

/** @param {Planned} plan */
function build(plan) {
  rows.clear();
  get("plan-areas").replaceChildren(...plan.areas.map((area) => {
    const mover = button(`Move ${area.name}`, () => choose(area.name), {
      "aria-pressed": "false",
      "aria-describedby": "plan-keys",
      "data-mover": area.name,
    });
    mover.addEventListener("keydown", (event) => on_key(event, area.name));
    mover.addEventListener("focus", () => choose(area.name));
    const undo = button("Back to the plan", () => move(area.name, null), { "aria-label": `Back to the plan: ${area.name}` });
    const keep = button("Keep as a sortie", () => keep_area(area.name), { "aria-label": `Keep ${area.name} as a sortie` });
    const row = { pos: make("p", { "data-pos": area.name }), notes: make("p", { class: "wrong" }), mover, undo };
    rows.set(area.name, row);
    return make("li", {}, make("p", { class: "name" }, `${area.name} ${area.unit}`), row.pos, row.notes, make("p", { class: "line" }, mover, undo, keep));
  }));
  get("plan-warned").replaceChildren(...plan.warnings.map((line) => make("li", {}, line)));
  tell();
}

/** Write the figures of the plan. */
function tell() {
  const { plan, now } = own;
  if (!plan) return;
  const moved = Object.keys(own.moves).length > 0;
  const bound = plan.bound === null ? "" : `; no plan of these units is above ${percent(plan.bound)}`;
  get("plan-total").textContent = `POS of the plan ${percent(plan.total)}${bound}.`;
  get("plan-now").textContent = now && moved ? `As moved: ${percent(now.total)} (${signed(now.total - now.as_planned)} against the plan).` : "";
  for (const area of plan.areas) {
    const row = rows.get(area.name);
    if (!row) continue;
    const own_now = now?.areas.find((one) => one.name === area.name);
    const words = own_now && moved ? `POS ${percent(area.pos)} as planned, ${percent(own_now.pos)} as moved` : `POS ${percent(area.pos)}`;
    row.pos.textContent = `${words}; ${(own_now ?? area).period}`;
    row.notes.textContent = (own_now?.notes ?? []).join(". ");
    row.notes.hidden = !row.notes.textContent;
    row.undo.hidden = !own.moves[area.name];
    row.mover.setAttribute("aria-pressed", String(own.chosen === area.name));
  }
}

/** @param {number} difference */
const signed = (difference) => `${difference < 0 ? "−" : "+"}${(100 * Math.abs(difference)).toFixed(1)} points`;

/** @param {string} name */
function choose(name) {
  if (own.chosen !== name) {
    own.chosen = name;
    show_time();
  }
  draw();
  tell();
}

/** Show the map at the middle of the time that the chosen sub-area is searched. */
function show_time() {
  const area = planned(own.chosen);
  if (area) sea.go_to_time((epoch(area.start) + epoch(area.end)) / 2);
}

// --- on the map ----------------------------------------------------------------------------------------------------------
/** @param {string} name @returns {PlannedArea | undefined} */
const planned = (name) => own.plan?.areas.find((area) => area.name === name);

/** @param {string} name @returns {Move} */
const move_of = (name) => own.moves[name] ?? { at: planned(name)?.centre ?? [0, 0], turned: 0 };

/** Draw the sub-areas where the server has computed them, shifted to where they are now. */
function draw() {
  drawn.source.clear(true);
  handles.source.clear(true);
  const { plan } = own;
  if (!plan) return;
  for (const area of plan.areas) {
    const computed = own.now?.areas.find((one) => one.name === area.name) ?? area;
    const moved = move_of(area.name);
    const pos = Object.keys(own.moves).length ? computed.pos : area.pos;
    const more = { area: area.name };
    const looks = { outline: "planned", legs: "planned_legs", label: `${area.name} ${percent(pos)}`, strong: own.chosen === area.name, more };
    const features = search_shapes(computed, looks);
    const [from, to] = [on_map([computed.centre])[0], on_map([moved.at], computed.centre[0])[0]];
    const turn = ((area.orientation + moved.turned - computed.orientation) * Math.PI) / 180;
    for (const feature of features) {
      const geometry = feature.getGeometry();
      if (Math.abs(Math.sin(turn / 2)) > 1e-9) geometry?.rotate(-turn, from);
      geometry?.translate(to[0] - from[0], to[1] - from[1]);
    }
    drawn.source.addFeatures(features);
    if (own.chosen === area.name) handles.source.addFeature(shape("point", [handle_of(area)], { look: "way", handle: area.name, label: "turn" }));
  }
}

/**
 * Return where the handle of a sub-area is: ahead of it, beyond its edge.
 * @param {PlannedArea} area
 * @returns {Point}
 */
function handle_of(area) {
  const { at, turned } = move_of(area.name);
  const angle = (area.orientation + turned) * RAD;
  const reach = (0.5 * area.length_nmi + 0.8) * NMI;
  return shifted(at, reach * Math.sin(angle), reach * Math.cos(angle));
}

/** @param {Point} at @param {number} east [m] @param {number} north [m] @returns {Point} */
function shifted([lon, lat], east, north) {
  return [lon + east / R / RAD / Math.cos(lat * RAD), lat + north / R / RAD];
}

/** @param {string} name @param {Move | null} to null: as planned */
function move(name, to) {
  if (to === null) delete own.moves[name];
  else own.moves[name] = { at: [near(to.at[0], 0), Math.max(-85, Math.min(85, to.at[1]))], turned: to.turned - 360 * Math.round(to.turned / 360) };
  draw();
  compute();
}

let grasped = /** @type {{name: string, turns: boolean, from: number[], begun: Move} | null} */ (null);
const drag = new ol.interaction.Pointer({
  handleDownEvent: (event) => {
    const found = sea.chart.forEachFeatureAtPixel(event.pixel, (feature) => feature, {
      hitTolerance: 6,
      layerFilter: (layer) => layer === drawn.layer || layer === handles.layer,
    });
    const name = found?.get("handle") ?? found?.get("area");
    if (!name || sea.picking()) return false;
    grasped = { name, turns: Boolean(found?.get("handle")), from: event.coordinate, begun: move_of(name) };
    if (own.chosen !== name) choose(name);
    return true;
  },
  handleDragEvent: (event) => {
    if (!grasped) return;
    const { name, turns, from, begun } = grasped;
    const area = planned(name);
    if (!area) return;
    const middle = on_map([begun.at], sea.map.inverse(from)[0])[0];
    if (turns) {
      const [east, north] = [event.coordinate[0] - middle[0], event.coordinate[1] - middle[1]];
      move(name, { at: begun.at, turned: Math.atan2(east, north) / RAD - area.orientation });
    } else {
      const to = [middle[0] + event.coordinate[0] - from[0], middle[1] + event.coordinate[1] - from[1]];
      move(name, { at: sea.inverse(to), turned: begun.turned });
    }
  },
  handleUpEvent: () => {
    grasped = null;
    return false;
  },
});
sea.chart.addInteraction(drag);

/**
 * Move a sub-area by the keyboard.
 * @param {KeyboardEvent} event
 * @param {string} name
 */
function on_key(event, name) {
  /** @type {Record<string, [number, number]>} */
  const ways = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const way = ways[event.key];
  const turn = event.key === "[" ? -TURN : event.key === "]" ? TURN : 0;
  if (!way && !turn) return;
  event.preventDefault();
  const { at, turned } = move_of(name);
  const step = STEP * (event.shiftKey ? 5 : 1);
  move(name, { at: way ? shifted(at, step * way[0], step * way[1]) : at, turned: turned + turn });
}

// --- the POS of a move ---------------------------------------------------------------------------------------------------
/** Ask the server for the POS as moved; while it computes, only the newest move waits. */
async function compute() {
  if (own.busy) {
    own.again = true;
    return;
  }
  own.busy = true;
  const begun = performance.now();
  const mine = own.shown;
  const run = own.run;
  try {
    /** @type {MovedPlan} */
    const now = await ask("/api/plan/pos", { run, moves: own.moves });
    if (mine === own.shown) {
      own.now = now;
      const waited = Math.round(performance.now() - begun);
      get("plan-said").textContent = Object.keys(own.moves).length ? `Computed in ${waited} ms.` : "Ready: the POS of a move is computed at once.";
      get("plan-said").dataset.ms = String(waited);
      draw();
      tell();
    }
  } catch (error) {
    if (!(error instanceof Error)) throw error;
    if (mine === own.shown) get("plan-said").textContent = error.message;
  } finally {
    own.busy = false;
    if (own.again && own.plan) {
      own.again = false;
      compute();
    }
  }
}

/** @param {string} name */
async function keep_area(name) {
  const { run, moves } = own;
  const its_case = `${run.replace(/-plan(-\d+)?$/, "")}.toml`;
  if (opened.name !== its_case) {
    get("plan-said").textContent = `This is a plan of ${its_case}: open that case to keep a sub-area in it.`;
    return;
  }
  const kept = name in moves ? { [name]: moves[name] } : {};
  await form.work_on_text(null, async () => {
    /** @type {{text: string, name: string}} */
    const told = await ask("/api/plan/keep", { run, moves: kept, area: name, text: text.value });
    get("plan-said").textContent = `Kept as the sortie "${told.name}": the next run takes it as flown, and as having found nothing. Enter what was carried out below.`;
    return told.text;
  });
}

