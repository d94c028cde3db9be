// Rows of the step "Search": the inputs of one table of the case, which stay the same elements while the table keeps its fields.
import { button, make } from "./kit.js";

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
  } else if (spec.kind === "places") {
    const input = make("textarea", { id, rows: 4, "data-own": field });
    listen(input, () => (input.value.trim() ? lines_of(input.value) : null));
    place.append(label, input, picker(field, spec, tools, (at) => [...lines_of(input.value), at]));
  } else {
    const number = spec.kind === "number" || spec.kind === "degrees";
    const input = make("input", { id, size: spec.kind === "place" ? 22 : spec.size ?? 5, "data-own": field, placeholder: spec.hint ?? null, inputmode: number ? "decimal" : null });
    listen(input, () => (number ? number_of(input.value) : input.value.trim() || null));
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
  const work = () => tools.pick(field, (at) => tools.set([{ field, value: value(at) }]), spec.kind === "places");
  return button("Click on the map", work, { "data-pick": field, "aria-pressed": "false", "aria-label": words });
}

/** @param {string} words @returns {string[]} */
const lines_of = (words) => words.split("\n").map((one) => one.trim()).filter(Boolean);

/** @param {string} words @returns {Value} a number if it is one */
function number_of(words) {
  const plain = words.trim();
  return plain === "" ? null : Number.isFinite(Number(plain)) ? Number(plain) : plain;
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
      const words = Array.isArray(value) ? value.join("\n") : String(value ?? "");
      input.value = hidden ? "set in the text" : words;
    }
  }
}
