// What the page shows of a spill: the fields of each kind of row, in the words of a responder. A row is a table of the case.

/** @type {FieldSpec} */
const NAME = { key: "name", label: "Name", size: 16 };
/** @type {FieldSpec} */
const DETECTION = { key: "detection", label: "Chance that it sees an object lying there", kind: "number", size: 6, hint: "0.7" };
/** @type {FieldSpec} */
const STRETCHES = { key: "stretches", label: "Stretches, one a line, by name or id", kind: "lines" };
const never = () => false;
/** @param {string} key @returns {(values: Values) => boolean} */
const has = (key) => (values) => key in values;

// --- the release ---------------------------------------------------------------------------------------------------------
/** @param {string[]} files @returns {Variant[]} how the ship's track is given */
export const tracks = (files) => [
  {
    id: "typed",
    words: "typed, or clicked on the map",
    fits: ({ track }) => Array.isArray(track),
    fields: [{ key: "track", label: "Where the ship was, with its times: one place a line", kind: "fixes", hint: "53 25N 004 15E, 281700ZNOV26" }],
    begin: () => ({ track: null }),
  },
  {
    id: "file",
    words: "a file of this folder (GPX with times, CSV, netCDF)",
    fits: ({ track }) => typeof track === "string",
    fields: [{ key: "track", label: "File", kind: "file" }, { key: "ship", label: "Which ship of the file, if it has several", size: 14 }],
    begin: () => ({ track: files[0] ?? "ais.csv" }),
  },
];
/** @type {FieldSpec[]} */
export const CLOCK = [{ key: "clock_error", label: "These times may be wrong by up to", size: 7, hint: "5 min" }];
/** @type {FieldSpec[]} */
export const LOSS = [
  { key: "begin", label: "It began at, or from .. to", kind: "range", size: 34, hint: "281900ZNOV26 to 282130ZNOV26" },
  { key: "length", label: "It lasted", kind: "range", size: 16, hint: "10 min to 2 h" },
  { key: "share", label: "Share of the objects", kind: "number", size: 5, hint: "0.8" },
];
/** @type {FieldSpec[]} */
export const RELEASE = [
  { key: "release_duration", label: "They went adrift one by one over", size: 7, hint: "2 h" },
  { key: "release_std", label: "Scattered by (one standard deviation)", size: 7, hint: "500 m" },
];

// --- what was lost -------------------------------------------------------------------------------------------------------
/** @param {[string, string][]} objects @returns {Variant[]} */
export const drifting = (objects) => [
  {
    id: "immersed",
    words: "a box, container or drum",
    fits: has("object.immersion"),
    fields: [{ key: "object.immersion", label: "How deep it floats: share under water (0 to 1)", kind: "range", size: 11, hint: "0.6 to 0.9" }],
    begin: () => ({ object: null, "object.immersion": [0.6, 0.9] }),
  },
  {
    id: "listed",
    words: "another object, of the list",
    fits: has("object"),
    fields: [{ key: "object", label: "Object", kind: "choice", choices: [["", "choose ..."], ...objects] }],
    begin: () => ({ "object.immersion": null, object: "WATER" }),
  },
];
/** @type {Variant[]} */
export const SINKING = [
  { id: "floats", words: "it stays afloat", fits: never, fields: [], begin: () => ({}) },
  {
    id: "hazard",
    words: "it may sink at any time",
    fits: has("sinking.half_life"),
    fields: [{ key: "sinking.half_life", label: "Half of them have sunk after", kind: "range", size: 14, hint: "2 d to 20 d" }],
    begin: () => ({ "sinking.half_life": ["2 d", "20 d"] }),
  },
  {
    id: "waterlogged",
    words: "it fills with water, then sinks",
    fits: has("sinking.waterlogged"),
    fields: [{ key: "sinking.waterlogged", label: "Half of them have sunk after", kind: "range", size: 14, hint: "10 d to 60 d" },
      { key: "sinking.spread", label: "They differ by a factor of", kind: "number", size: 5, hint: "1.5" }],
    begin: () => ({ "sinking.waterlogged": ["10 d", "60 d"] }),
  },
];
/** @type {FieldSpec[]} */
export const CLASS = [NAME, { key: "number", label: "Number lost", kind: "range", size: 11, hint: "50 to 60" }];
/** @type {FieldSpec[]} */
export const SHARED = [
  { key: "destroyed", label: "Share broken up at once (0 to 1)", kind: "range", size: 9, hint: "0 to 0.2" },
  { key: "windage_bias", label: "How well their drift by the wind is known (0.2: to 20 %)", kind: "number", size: 5, hint: "0.2" },
  { key: "worlds", label: "Simulated spills (more: slower, finer)", kind: "number", size: 6, hint: "2000" },
  { key: "stretches.length", label: "Length of a stretch of coast", size: 7, hint: "10 km" },
];

// --- finds and patrols ---------------------------------------------------------------------------------------------------
/** @type {Variant[]} */
export const FOUND_AT = [
  {
    id: "shore",
    words: "on the shore, at a place",
    fits: (values) => "at" in values && values.at_sea !== true,
    fields: [{ key: "at", label: "Place", kind: "place" }],
    begin: ({ at }) => ({ at: at ?? "", at_sea: null }),
  },
  {
    id: "stretch",
    words: "somewhere on a stretch of coast",
    fits: has("stretch"),
    fields: [{ key: "stretch", label: "Stretch, by name or id", size: 22 }],
    begin: () => ({ stretch: "", at_sea: null }),
  },
  {
    id: "sea",
    words: "adrift at sea",
    fits: ({ at_sea }) => at_sea === true,
    fields: [{ key: "at", label: "Place", kind: "place" }, { key: "radius", label: "Within", size: 7, hint: "5 km" }],
    begin: ({ at }) => ({ at: at ?? "", at_sea: true }),
  },
];
/** @type {Variant[]} */
export const FOUND_WHEN = [
  { id: "time", words: "at this time", fits: has("time"), fields: [{ key: "time", label: "Time", size: 16, hint: "301516ZNOV26 or +40 h" }], begin: ({ by_time }) => ({ time: by_time ?? "" }) },
  {
    id: "latest",
    words: "lying there, at this time at the latest",
    fits: has("by_time"),
    fields: [{ key: "by_time", label: "Latest time", size: 16, hint: "301516ZNOV26 or +40 h" }],
    begin: ({ time }) => ({ by_time: time ?? "" }),
  },
  { id: "patrol", words: "by a patrol, when it was there", fits: ({ by }) => by !== undefined, fields: [], begin: () => ({}) },
];
/** @param {string[]} classes @param {string[]} patrols @returns {FieldSpec[]} */
export const find_fields = (classes, patrols) => [
  NAME,
  { key: "class", label: "What it is", kind: "choice", choices: [["", "not known"], ...classes.map((one) => /** @type {[string, string]} */ ([one, one]))] },
  { key: "by", label: "Found by", kind: "choice", choices: [["", "the public"], ...patrols.map((one) => /** @type {[string, string]} */ ([one, one]))] },
  { key: "false", label: "Chance that it is not of this spill (0 to 1)", kind: "number", size: 5, hint: "0" },
];
/** @type {Variant[]} */
export const WALKED = [
  {
    id: "between",
    words: "the shore between two places",
    fits: has("between"),
    fields: [{ key: "between", label: "From and to, one a line", kind: "places" }],
    begin: () => ({ stretches: null, between: [""] }),
  },
  { id: "stretches", words: "stretches of coast", fits: has("stretches"), fields: [STRETCHES], begin: () => ({ between: null, stretches: [""] }) },
];
/** @type {FieldSpec[]} */
export const PATROL = [NAME, { key: "time", label: "Time", size: 16, hint: "301500ZNOV26 or +40 h" }, DETECTION];
/** @type {Variant[]} */
export const REACH = [
  { id: "anywhere", words: "to any stretch of one land mass", fits: never, fields: [], begin: () => ({}) },
  {
    id: "base",
    words: "as far as it gets from its base",
    fits: has("base"),
    fields: [{ key: "base", label: "Base", kind: "place" }, { key: "reach", label: "Reach, over land", size: 7, hint: "40 km" }],
    begin: () => ({ base: "", reach: "40 km" }),
  },
  { id: "stretches", words: "to these stretches", fits: has("stretches"), fields: [STRETCHES], begin: () => ({ stretches: [""] }) },
];
/** @type {FieldSpec[]} */
export const TEAM = [
  NAME,
  { key: "length", label: "Shore that it can search in a day", size: 7, hint: "20 km" },
  DETECTION,
  { key: "first", label: "First patrol", size: 16, hint: "011400ZDEC26 or +72 h" },
  { key: "days", label: "Days", kind: "number", size: 3, hint: "1" },
  { key: "crosses_water", label: "It has a boat, and crosses water", kind: "tick", otherwise: false },
];
/** @type {FieldSpec[]} */
export const SILENCE = [{ key: "reporting.until", label: "You know of all finds up to (if later than the last one)", size: 16, hint: "+60 h" }];

/** @param {Variant[]} variants @returns {FieldSpec[]} */
export const fields_of = (variants) => variants.flatMap((one) => one.fields);
