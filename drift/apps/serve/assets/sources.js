// The inputs of wind and current: as reported, constant or by time, or files of the folder.
import { all, ask, button, get, make } from "./kit.js";

/** @type {SourceName[]} */
export const SOURCES = ["wind", "current"];
const KINDS = [
  ["", "none yet"],
  ["constant", "as reported, the same all the time"],
  ["table", "as reported, by time"],
  ["files", "files of this folder"],
];
/** @type {Record<SourceName, "from" | "toward">} */
const DIRECTIONS = { wind: "from", current: "toward" };
const WORDS = { wind: "Wind", current: "Current" };
const RATES = { wind: "15 kn", current: "0.5 kn" };

/** What the inputs work with: files of winds and currents in the folder, and who hears of changes. */
const own = {
  files: /** @type {string[]} */ ([]),
  changed: /** @type {(what: SourceName) => void} */ (() => {}),
  covers: () => {}, // hears that another file's box is known
};
/** @type {Map<string, Covered[]>} */
const boxes = new Map();
/** @type {Map<string, Promise<string>>} */
const covers = new Map();

/**
 * Return the list that chooses the kind of a source.
 * @param {SourceName} what
 */
export function kind_of(what) {
  return /** @type {HTMLSelectElement} */ (get(`${what}-kind`));
}

/**
 * Return the place of a source's inputs.
 * @param {SourceName} what
 */
function place_of(what) {
  return all(`[data-rows="${what}"]`)[0];
}

/**
 * Make the inputs of both sources.
 * @param {(what: SourceName) => void} changed called when the user has changed a source
 */
export function build(changed) {
  own.changed = changed;
  for (const what of SOURCES) {
    const kind = make("select", { id: `${what}-kind` });
    for (const [value, label] of KINDS) kind.append(make("option", { value }, label));
    const label = make("label", { for: `${what}-kind` }, WORDS[what]);
    all(`[data-source="${what}"]`)[0].append(make("p", {}, label, " ", kind), make("div", { "data-rows": what }));
    kind.addEventListener("change", () => {
      rows(what, begun(/** @type {Source["kind"]} */ (kind.value)));
      changed(what);
    });
  }
}

/**
 * Ask the server for the files of winds and currents in the folder.
 */
export async function list_files() {
  /** @type {{files: string[]}} */
  const { files } = await ask("/api/forcing", { file: null });
  own.files = files;
}

/**
 * Return an empty source of a kind.
 * @param {Source["kind"]} kind
 * @returns {Source}
 */
function begun(kind) {
  if (kind === "table") return { kind, rows: [{}, {}] };
  return kind === "files" ? { kind, files: [] } : { kind };
}

/**
 * Show that the text has more of a source than the form.
 * @param {SourceName} what
 */
export function in_text(what) {
  place_of(what).replaceChildren(make("p", { class: "soft" }, "Set in the text."));
}

/**
 * Make the inputs of a source.
 * @param {SourceName} what
 * @param {Source | null} value as the server tells it
 */
export function rows(what, value) {
  kind_of(what).value = value?.kind ?? "";
  place_of(what).replaceChildren();
  if (!value?.kind) return;
  if (value.kind === "files") file_rows(what, value.files ?? []);
  else if (value.kind === "constant") number_row(what, value, null);
  else table_rows(what, value.rows ?? []);
}

/**
 * @param {SourceName} what
 * @param {string[]} chosen
 */
function file_rows(what, chosen) {
  const place = place_of(what);
  for (const file of new Set([...own.files, ...chosen])) {
    const tick = make("input", { type: "checkbox", value: file, checked: chosen.includes(file) });
    const cover = make("small", {});
    tell_cover(file, cover);
    tick.addEventListener("change", () => own.changed(what));
    place.append(make("p", {}, make("label", {}, tick, ` ${file} `), cover));
  }
  if (!place.firstChild) place.append(make("p", { class: "soft" }, "No netCDF or GRIB file lies in this folder."));
}

/**
 * @param {SourceName} what
 * @param {SourceRow[]} table
 */
function table_rows(what, table) {
  table.forEach((row, k) => number_row(what, row, k, table.length > 1));
  const more = button("One more time", () => rows(what, { kind: "table", rows: [...(typed(what).rows ?? []), {}] }));
  place_of(what).append(make("p", {}, more));
}

/**
 * Make the inputs of one speed and direction.
 * @param {SourceName} what
 * @param {SourceRow} row
 * @param {number | null} k of a row of a table, null for a constant
 * @param {boolean} [removable]
 */
function number_row(what, row, k, removable = false) {
  const direction = DIRECTIONS[what];
  const words = WORDS[what];
  const several = k === null ? "" : ` ${k + 1}`;
  const line = make("p", { "data-row": k ?? 0 });
  if (k !== null) line.append(box_of(`${words} time${several}`, row.time, 13, { "data-key": "time", placeholder: k ? "+24 h" : "+0 h" }), " ");
  line.append(
    box_of(`${words} speed${several}`, row.speed, 6, { "data-key": "speed", placeholder: RATES[what] }),
    ` ${direction} `,
    box_of(`${words} ${direction}${several}, degrees true`, row[direction], 4, {
      "data-key": direction,
      placeholder: "240",
      inputmode: "numeric",
    }),
    "°",
  );
  if (removable) {
    const remove = () => {
      line.remove();
      own.changed(what);
    };
    line.append(" ", button("−", remove, { "aria-label": `Remove row${several} of the ${what}` }));
  }
  for (const input of all("input", line)) input.addEventListener("change", () => own.changed(what));
  place_of(what).append(line);
}

/**
 * @param {string} label
 * @param {string | number | undefined} value
 * @param {number} size
 * @param {Record<string, string>} attributes
 */
function box_of(label, value, size, attributes) {
  const input = make("input", { size, "aria-label": label, ...attributes });
  input.value = String(value ?? "");
  return input;
}

/**
 * Return what is typed of a source.
 * @param {SourceName} what
 * @returns {Source}
 */
export function typed(what) {
  const kind = /** @type {Source["kind"]} */ (kind_of(what).value);
  const place = place_of(what);
  if (!kind) return { kind };
  if (kind === "files") {
    /** @type {HTMLInputElement[]} */
    const ticked = all("input:checked", place);
    return { kind, files: ticked.map((one) => one.value) };
  }
  const found = all("[data-row]", place).map(row_typed);
  return kind === "constant" ? { kind, ...found[0] } : { kind, rows: found };
}

/**
 * @param {HTMLElement} line
 * @returns {SourceRow}
 */
function row_typed(line) {
  /** @type {HTMLInputElement[]} */
  const inputs = all("[data-key]", line);
  return Object.fromEntries(inputs.map((input) => {
    const key = input.dataset.key ?? "";
    const words = input.value.trim();
    const number = ["from", "toward"].includes(key) && words !== "" && Number.isFinite(Number(words));
    return [key, number ? Number(words) : words];
  }));
}

/**
 * Return whether nothing is left out of a source.
 * @param {Source} value
 */
export function whole(value) {
  if (!value.kind) return true;
  const parts = value.files ?? value.rows?.flatMap((row) => Object.values(row)) ?? Object.values(value);
  return parts.length > 0 && parts.every((one) => one !== "");
}

/**
 * Return a source as text that does not depend on the order of its keys.
 * @param {Source | null} value
 */
export function canonical(value) {
  /** @param {object} one */
  const sorted = (one) => Object.entries(one).sort().join(";");
  return value?.kind ? JSON.stringify([sorted({ ...value, rows: "", files: "" }), value.files, value.rows?.map(sorted)]) : "";
}

/**
 * Write what a file of winds or currents covers.
 * @param {string} file
 * @param {HTMLElement} place
 */
async function tell_cover(file, place) {
  if (!covers.has(file)) covers.set(file, cover_of(file).catch((error) => error.message));
  place.textContent = (await covers.get(file)) ?? "";
  own.covers();
}

/** Call something when more is known of what files cover. @param {() => void} follower */
export function follow_covers(follower) {
  own.covers = follower;
}

/**
 * Return what the chosen files of a source cover, as far as it is known.
 * @param {SourceName} what
 */
export function covered(what) {
  const files = kind_of(what).value === "files" ? typed(what).files ?? [] : [];
  return files.flatMap((file) => (boxes.get(file) ?? []).filter(({ quantity }) => quantity === what).map(({ box }) => ({ file, box })));
}

/** @param {string} file */
async function cover_of(file) {
  /** @type {{sources: Covered[]}} */
  const { sources } = await ask("/api/forcing", { file });
  boxes.set(file, sources);
  /** @param {number} value */
  const edge = (value) => Number(value.toFixed(1));
  const told = sources.map(({ quantity, box: [west, south, east, north], times }) => {
    const lasts = times.map((one) => group(epoch(one))).join(" to ") || "no time";
    return `${quantity}, ${lasts}, ${edge(south)} to ${edge(north)} N, ${edge(west)} to ${edge(east)} E`;
  });
  return told.join("; ") || "no wind and no current";
}
