// What the step "Search" shows: the fields of each kind of row, in the words of a planner. A row is a table of the case.

/** @type {FieldSpec} */
const NAME = { key: "name", label: "Name", size: 16 };
/** @type {FieldSpec} */
const SPEED = { key: "speed", label: "Speed", size: 7, hint: "14 kn" };
/** @type {FieldSpec} */
const START = { key: "start", label: "Begins", size: 14, hint: "281530ZNOV26 or +4 h" };
/** @type {FieldSpec} */
const CENTRE = { key: "pattern.centre", label: "Middle", kind: "place" };
/** @type {FieldSpec} */
const DATUM = { key: "pattern.datum", label: "Commence search point", kind: "place" };
/** @type {FieldSpec} */
const SPACING = { key: "pattern.spacing", label: "Track spacing", size: 7, hint: "1 nmi" };
/** @type {FieldSpec[]} */
const RECTANGLE = [
  CENTRE,
  { key: "pattern.corner", label: "Commences at the corner", kind: "place", hint: "SW, or a position" },
  { key: "pattern.length", label: "Length", size: 7, hint: "6 nmi" },
  { key: "pattern.width", label: "Width", size: 7, hint: "3 nmi" },
  { key: "pattern.orientation", label: "Course along the length", kind: "degrees" },
  SPACING,
];
/** @type {FieldSpec} */
const PLATFORM = {
  key: "unit",
  label: "Searches from",
  kind: "choice",
  choices: [["", "another platform"], ["Boat", "a boat"], ["Helicopter", "a helicopter"], ["Aircraft", "an aircraft"]],
};
/** @type {FieldSpec} */
const SHORE = { key: "ashore", label: "It also saw the shore", kind: "tick", otherwise: true };
/** @type {FieldSpec} */
const COMPLETED = { key: "completed", label: "Share that was carried out", size: 6, hint: "100 %" };

/** The kinds of sorties: how each is recognised, its fields, and what a new one begins with. */
export const PATTERNS = /** @type {Record<string, PatternSpec>} */ ({
  parallel: { label: "Parallel sweep", fields: RECTANGLE },
  creeping: { label: "Creeping line ahead", fields: RECTANGLE },
  square: {
    label: "Expanding square",
    fields: [DATUM, SPACING, { key: "pattern.orientation", label: "Course of the first leg", kind: "degrees" },
      { key: "pattern.legs", label: "Legs", kind: "number", hint: "12" }],
  },
  sector: {
    label: "Sector search",
    fields: [{ ...DATUM, label: "Middle (datum)" }, { key: "pattern.radius", label: "Radius", size: 7, hint: "3 nmi" },
      { key: "pattern.orientation", label: "Course of the first leg", kind: "degrees" },
      { key: "pattern.sectors", label: "Sectors", kind: "number", hint: "3" }],
  },
  trackline: {
    label: "Track line",
    fields: [{ key: "pattern.waypoints", label: "Way points, one a line", kind: "places" },
      { key: "pattern.offset", label: "To the right of it by", size: 7, hint: "0 nmi" },
      { key: "pattern.return", label: "And back on the other side", kind: "tick", otherwise: false }],
  },
  area: {
    label: "An area, without known legs",
    fields: [{ key: "end", label: "Ends", size: 14, hint: "+6 h" }, { key: "area.centre", label: "Middle", kind: "place" },
      { key: "area.length", label: "Length", size: 7, hint: "6 nmi" }, { key: "area.width", label: "Width", size: 7, hint: "3 nmi" },
      { key: "area.orientation", label: "Course along the length", kind: "degrees" },
      { key: "pod", label: "POD, if it was told", size: 6, hint: "60 %" }],
  },
  track: { label: "The track it made good (GPX)", fields: [{ key: "track", label: "File of this folder", kind: "file" }] },
  text: { label: "Set in the text", fields: [] },
});

/** @type {FieldSpec[]} */
export const WIDTH = [{ key: "sweep_width", label: "Sweep width", size: 8, hint: "0.5 nmi" }];
/** @type {FieldSpec[]} */
export const CONDITIONS = [
  { key: "sweep_width.visibility", label: "Visibility", size: 6, hint: "10 nmi" },
  { key: "sweep_width.wind", label: "Wind", size: 6, hint: "12 kn" },
  { key: "sweep_width.seas", label: "Seas", size: 6, hint: "3 ft" },
  { key: "altitude", label: "Height of flight or eye", size: 7, hint: "500 ft" },
];

/** @param {Values} values the fields of a sortie @returns {string} its kind, one of PATTERNS */
export function kind_of_sortie(values) {
  if (typeof values["pattern.kind"] === "string" && values["pattern.kind"] in PATTERNS) return values["pattern.kind"];
  if ("track" in values) return "track";
  return Object.keys(values).some((key) => key.startsWith("area.")) ? "area" : "text";
}

/** @param {Values} values @returns {FieldSpec[]} */
export function fields_of_sortie(values) {
  const own = PATTERNS[kind_of_sortie(values)];
  return [NAME, PLATFORM, START, SPEED, ...own.fields, COMPLETED, SHORE];
}

/** The kinds of contacts. */
export const CONTACTS = /** @type {Record<string, PatternSpec>} */ ({
  position: { label: "Sighting, beacon or other position", fields: [] },
  debris: { label: "Find of debris", fields: [] },
  bearing: { label: "Bearing (flare, direction finder)", fields: [] },
  range: { label: "Distance", fields: [] },
});
/** @type {FieldSpec[]} */
const SEEN = [
  { key: "position.at", label: "Position", kind: "place" },
  { key: "position.error", label: "Error: half the probability is within", size: 7, hint: "0.5 nmi" },
];

/** @param {Values} values @returns {string} */
export function kind_of_contact(values) {
  if (Object.keys(values).some((key) => key.startsWith("bearing."))) return "bearing";
  if (Object.keys(values).some((key) => key.startsWith("range."))) return "range";
  return "of" in values ? "debris" : "position";
}

/** @param {Values} values @returns {FieldSpec[]} */
export function fields_of_contact(values) {
  /** @type {Record<string, FieldSpec[]>} */
  const own = {
    position: SEEN,
    debris: [{ key: "of", label: "What was found drifts as", size: 20, hint: "PIW-1, of drift objects" }, ...SEEN],
    bearing: [{ key: "bearing.from", label: "Taken from", kind: "place" }, { key: "bearing.bearing", label: "Bearing", kind: "degrees" },
      { key: "bearing.std", label: "Its error (one standard deviation)", size: 7, hint: "3 deg" },
      { key: "bearing.far", label: "Not farther than", size: 7, hint: "20 nmi" }],
    range: [{ key: "range.from", label: "Taken from", kind: "place" }, { key: "range.range", label: "Distance", size: 7, hint: "4 nmi" },
      { key: "range.std", label: "Its error (one standard deviation)", size: 7, hint: "0.5 nmi" }],
  };
  return [NAME, { key: "time", label: "Time", size: 14, hint: "+3 h" }, ...own[kind_of_contact(values)],
    { key: "belief", label: "Chance that it is from the object sought", size: 6, hint: "100 %" }];
}

/** @type {FieldSpec[]} */
export const UNIT = [
  NAME,
  { ...PLATFORM, key: "kind", label: "Is" },
  { key: "base", label: "Base", kind: "place" },
  { key: "ready", label: "Ready at, if not when the plan begins", size: 14, hint: "+9 h" },
  { key: "search_speed", label: "Search speed", size: 7, hint: "14 kn" },
  { key: "transit_speed", label: "Transit speed, if faster", size: 7, hint: "20 kn" },
  { key: "endurance", label: "Endurance on scene", size: 6, hint: "4 h" },
  { key: "sensor", label: "Searches by", kind: "choice", choices: [["", "eye"], ["radar", "radar"], ["infrared", "infrared"], ["nvg", "night vision"], ["other", "another sensor"]] },
  { key: "daylight", label: "By daylight only", kind: "tick", otherwise: true },
  { key: "sweep_width_uncertainty", label: "The sweep width is known to", size: 6, hint: "30 %" },
];

/** @type {FieldSpec[]} */
export const PLAN = [
  { key: "begin", label: "Begins, if not after the last sortie", size: 14, hint: "+8 h" },
  { key: "until", label: "Ends", size: 14, hint: "+16 h" },
  { key: "separation", label: "Keep units apart by", size: 7, hint: "1 nmi" },
  { key: "rounds", label: "Sorties of each unit", kind: "number", hint: "1" },
  { key: "ashore", label: "Units also search the shore", kind: "tick", otherwise: false },
];

const ASKED = ""; // a time or a place that only the planner knows: a message beside its field asks for it

/**
 * Return the table of a new sortie.
 * @param {string} kind one of PATTERNS
 * @param {{name: string, track: string}} given
 * @returns {Table}
 */
export function new_sortie(kind, { name, track }) {
  const common = { name, start: ASKED, speed: "14 kn", sweep_width: "0.5 nmi" };
  const rectangle = { centre: ASKED, length: "6 nmi", width: "3 nmi", orientation: 0 };
  if (kind === "area") return { name, start: ASKED, end: ASKED, speed: "14 kn", sweep_width: "0.5 nmi", area: rectangle };
  if (kind === "track") return { ...common, track };
  if (kind === "square") return { ...common, pattern: { kind, datum: ASKED, spacing: "0.5 nmi", orientation: 0, legs: 12 } };
  if (kind === "sector") return { ...common, pattern: { kind, datum: ASKED, radius: "3 nmi", orientation: 0 } };
  if (kind === "trackline") return { ...common, pattern: { kind, waypoints: [ASKED] } };
  return { ...common, pattern: { kind, ...rectangle, spacing: "1 nmi" } };
}

/**
 * Return the table of a new contact.
 * @param {string} kind one of CONTACTS
 * @param {{name: string}} given
 * @returns {Table}
 */
export function new_contact(kind, { name }) {
  if (kind === "bearing") return { name, time: ASKED, bearing: { from: ASKED, bearing: ASKED, std: "3 deg", far: "20 nmi" } };
  if (kind === "range") return { name, time: ASKED, range: { from: ASKED, range: ASKED, std: "0.5 nmi" } };
  const seen = { name, time: ASKED, position: { at: ASKED, error: "0.5 nmi" } };
  return kind === "debris" ? { ...seen, of: "PIW-1" } : seen;
}

/** What a unit of a kind begins with; its sweep width depends on what is sought. @type {Record<string, Table>} */
const OF_KIND = {
  Boat: { search_speed: "14 kn", endurance: "4 h" },
  Helicopter: { search_speed: "90 kn", endurance: "1.5 h" },
  Aircraft: { search_speed: "150 kn", endurance: "3 h" },
};

/**
 * Return the table of a new unit; its base is for the planner to give.
 * @param {{name: string}} given
 * @returns {Table}
 */
export function new_unit({ name }) {
  return { name, kind: "Boat", base: ASKED, ...OF_KIND.Boat, sweep_width: "0.5 nmi", daylight: false };
}

/**
 * Return what a unit of another kind begins with, without what the planner has typed.
 * @param {string} prefix unit and its number
 * @param {unknown} kind
 * @param {Values} values the unit as it is
 * @returns {Change[]}
 */
export function of_kind(prefix, kind, values) {
  /** @param {string} key */
  const untouched = (key) => Object.values(OF_KIND).some((one) => one[key] === values[key]);
  return Object.entries(OF_KIND[String(kind)] ?? {}).filter(([key]) => untouched(key))
    .map(([key, value]) => ({ field: `${prefix}.${key}`, value: /** @type {Value} */ (value) }));
}
