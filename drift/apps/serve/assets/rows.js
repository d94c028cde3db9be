// Rows of the step "Search": the inputs of one table of the case, which stay the same elements while the table keeps its fields.
import { all, button, make } from "./kit.js";

/**
 * Return a label with its input.
 * @param {string} field name of the field, such as sortie.0.speed
 * @param {FieldSpec} spec
 * @param {RowTools} tools
 */
function input_of(field, spec, tools) {
  const id = `own-${field.replaceAll(".", "-")}`;
  const label = make("label", { for: id }, spec.label);
  const place = make("p", {});
  /** @param {FieldInput} input @param {() => Value} value */
  const listen = (input, value) => input.addEventListener("change", () => tools.set([{ field, value: value() }]));
  if (spec.kind === "choice" || spec.kind === "file") {
    const choices = spec.kind === "file" ? tools.files().map((one) => [one, one]) : spec.choices ?? [];
    const input = make("select", { id, "data-own": field });
    input.append(...choices.map(([value, words]) => make("option", { value }, words)));
    listen(input, () => input.value || null);
    place.append(label, " ", input);
  } else if (spec.kind === "tick") {
    const input = make("input", { id, type: "checkbox", "data-own": field });
    listen(input, () => input.checked);
    place.append(input, " ", label);
  } else if (spec.kind === "places" || spec.kind === "fixes" || spec.kind === "lines") {
    const input = make("textarea", { id, rows: 4, "data-own": field, placeholder: spec.hint ?? null });
    listen(input, () => (input.value.trim() ? lines_of(input.value) : null));
    place.append(label, input);
    const end = spec.kind === "fixes" ? ", " : ""; // its time is to be typed
    if (spec.kind !== "lines") place.append(picker(field, spec, tools, (at) => [...lines_of(input.value), `${at}${end}`]));
  } else {
    const number = spec.kind === "number" || spec.kind === "degrees";
    const input = make("input", { id, size: spec.kind === "place" ? 22 : spec.size ?? 5, "data-own": field, placeholder: spec.hint ?? null, inputmode: number ? "decimal" : null });
    listen(input, () => (spec.kind === "range" ? range_of(input.value) : number ? number_of(input.value) : input.value.trim() || null));
    place.append(label, " ", input, spec.kind === "degrees" ? "° true" : "");
    if (spec.kind === "place") place.append(" ", picker(field, spec, tools, (at) => at));
  }
  return place;
}

/**
 * Return a button that takes a place from the map.
 * @param {string} field
 * @param {FieldSpec} spec
 * @param {RowTools} tools
 * @param {(at: string) => Value} value
 */
function picker(field, spec, tools, value) {
  const words = `${spec.label}: click on the map`;
  const work = () => tools.pick(field, (at) => tools.set([{ field, value: value(at) }]), spec.kind !== "place");
  return button("Click on the map", work, { "data-pick": field, "aria-pressed": "false", "aria-label": words });
}

/** @param {string} words @returns {string[]} */
const lines_of = (words) => words.split("\n").map((one) => one.trim()).filter(Boolean);

/** @param {string} words @returns {Value} a number if it is one */
function number_of(words) {
  const plain = words.trim();
  return plain === "" ? null : Number.isFinite(Number(plain)) ? Number(plain) : plain;
}

/** @param {string} words @returns {Value} one number or quantity, or the lowest and highest of "2 to 20" */
function range_of(words) {
  const parts = words.split(/\s+to\s+/).map(number_of);
  return parts.length === 2 ? /** @type {Value} */ (parts) : number_of(words);
}

/**
 * Return the inputs of a row.
 * @param {string} prefix table and number, such as sortie.0
 * @param {FieldSpec[]} specs
 * @param {RowTools} tools
 */
export function inputs_of(prefix, specs, tools) {
  return specs.map((spec) => input_of(`${prefix}.${spec.key}`, spec, tools));
}

/**
 * Write the values of a row into its inputs; one that is being typed into stays.
 * @param {ParentNode} inside
 * @param {string} prefix
 * @param {FieldSpec[]} specs
 * @param {Row} row
 */
export function fill_inputs(inside, prefix, specs, row) {
  for (const spec of specs) {
    /** @type {FieldInput | null} */
    const input = inside.querySelector(`[data-own="${prefix}.${spec.key}"]`);
    if (!input) continue;
    const hidden = row.in_text.some((key) => key === spec.key || key.startsWith(`${spec.key}.`));
    const value = row.values[spec.key];
    input.disabled = hidden;
    if (input instanceof HTMLInputElement && input.type === "checkbox") {
      input.checked = value === undefined ? Boolean(spec.otherwise) : value === true;
    } else if (input instanceof HTMLSelectElement) {
      const words = String(value ?? "");
      if (![...input.options].some((one) => one.value === words)) input.append(make("option", { value: words }, words));
      input.value = words;
    } else if (input !== document.activeElement || hidden) {
      const words = Array.isArray(value) ? value.join(spec.kind === "range" ? " to " : "\n") : String(value ?? "");
      input.value = hidden ? "set in the text" : words;
    }
  }
}

/**
 * Return a choice between sets of fields, and the inputs of the one that the row has.
 * @param {string} prefix
 * @param {string} label
 * @param {Variant[]} variants the first is that of a row that has none of their keys
 * @param {Values} values
 * @param {RowTools} tools
 */
export function variants_of(prefix, label, variants, values, tools) {
  const now = chosen(variants, values);
  const choice = make("select", { id: `own-${prefix.replaceAll(".", "-")}-${variants[0].id}` });
  choice.append(...variants.map((one) => make("option", { value: one.id }, one.words)));
  choice.value = now.id;
  choice.addEventListener("change", () => {
    const begin = variants.find((one) => one.id === choice.value)?.begin(values) ?? {};
    const before = variants.flatMap((one) => one.fields.map(({ key }) => key)).filter((key) => key in values && !(key in begin));
    const changes = [...new Set(before)].map((key) => ({ field: `${prefix}.${key}`, value: /** @type {Value} */ (null) }));
    for (const [key, value] of Object.entries(begin)) changes.push({ field: `${prefix}.${key}`, value });
    if (changes.length) tools.set(changes);
  });
  return [make("p", {}, make("label", { for: choice.id }, label), " ", choice), ...inputs_of(prefix, now.fields, tools)];
}

/** @param {Variant[]} variants @param {Values} values */
export const chosen = (variants, values) => variants.find((one) => one.fits(values)) ?? variants[0];

/**
 * Return a list of rows in a place of the page. Its elements stay while the tables keep their fields.
 * @param {HTMLElement} place
 * @param {RowList} spec
 * @param {RowTools} tools
 */
export function list_of(place, spec, tools) {
  const own = { built: "", open: /** @type {number | null} */ (null) };
  /** @param {Row} row @param {number} k */
  const name_of = ({ values }, k) => String(values.name ?? `${spec.stem} ${k + 1}`);
  /** @param {Row} row @param {number} k @param {boolean} open */
  const item_of = (row, k, open) => {
    const prefix = `${spec.table}.${k}`;
    const box = make("details", { "data-row": prefix, open }, make("summary", {}), ...spec.inputs(prefix, row));
    if (row.in_text.length) box.append(make("p", { class: "soft" }, `The text also sets ${row.in_text.join(", ")} of this row.`));
    const { look } = spec;
    box.append(make("p", { class: "line" }, look ? button("Show on the map", () => look(k), { "aria-label": `Show ${name_of(row, k)} on the map` }) : null,
      button("Remove", () => tools.set([{ field: prefix, value: null }]), { "aria-label": `Remove ${name_of(row, k)}` })));
    return make("li", {}, box);
  };
  return {
    /** Build the list again for another case. */
    again: () => Object.assign(own, { built: "", open: null }),
    /** Open a row that is about to be added. @param {number} k */
    open: (k) => Object.assign(own, { open: k }),
    /** @param {Row[]} rows */
    show(rows) {
      const sign = JSON.stringify([rows.map((row) => [spec.sign(row), row.in_text]), tools.files()]);
      if (own.built !== sign) {
        own.built = sign;
        const focus = document.activeElement instanceof HTMLElement ? document.activeElement : null;
        const [field, id] = [focus?.dataset.own, focus?.id];
        const open = new Set(all("details[open]", place).map((one) => one.dataset.row));
        if (own.open !== null) open.add(`${spec.table}.${own.open}`);
        if (own.open !== null && own.open < rows.length) own.open = null; // else the row is still to come
        place.replaceChildren(...rows.map((row, k) => item_of(row, k, open.has(`${spec.table}.${k}`))));
        if (!rows.length) place.append(make("li", { class: "soft" }, spec.empty));
        if (field && document.activeElement === document.body) all(`[data-own="${CSS.escape(field)}"]`)[0]?.focus();
        else if (id && document.activeElement === document.body) document.getElementById(id)?.focus();
      }
      rows.forEach((row, k) => {
        const item = place.children[k];
        fill_inputs(item, `${spec.table}.${k}`, spec.fields(row.values), row);
        const words = spec.heading(row, k).filter(Boolean).join(", ");
        item.querySelector("summary")?.replaceChildren(make("strong", {}, name_of(row, k)), words ? `: ${words}` : "");
      });
    },
  };
}
