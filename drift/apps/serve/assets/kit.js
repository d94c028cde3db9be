// What all parts of the page share: elements, requests to the server, and how times and sizes are written.
// Everything from the server or a case is inserted as text, never as markup.

/** A request that the server did not carry out; status is that of HTTP, 422 for mistakes in a case. */
export class Rejected extends Error {
  /**
   * @param {string} message
   * @param {number} status
   */
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/**
 * Return an element of the page.
 * @template {string} Id
 * @param {Id} id
 * @returns {ElementOf<Id>}
 */
export function get(id) {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no #${id}`);
  return /** @type {ElementOf<Id>} */ (found);
}

/**
 * Return all elements of a selector.
 * @template {HTMLElement} [Kind=HTMLElement]
 * @param {string} selector
 * @param {ParentNode} [inside]
 * @returns {Kind[]}
 */
export function all(selector, inside = document) {
  return [.../** @type {NodeListOf<Kind>} */ (inside.querySelectorAll(selector))];
}

/**
 * Put the cursor into an element, unless the user is typing elsewhere by now.
 * @param {HTMLElement | undefined} element
 */
export function focus_unless_typing(element) {
  if (!document.activeElement?.matches("input, select, textarea")) element?.focus();
}

/**
 * Make an element. A value of false or null leaves its attribute out.
 * @template {keyof HTMLElementTagNameMap} Kind
 * @param {Kind} kind
 * @param {Record<string, string | number | boolean | null>} [attributes]
 * @param {...(Node | string | null)} inside
 * @returns {HTMLElementTagNameMap[Kind]}
 */
export function make(kind, attributes = {}, ...inside) {
  const element = document.createElement(kind);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== null && value !== false) element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...inside.filter((one) => one !== null));
  return element;
}

/**
 * Make a button that does something.
 * @param {string} words
 * @param {() => unknown} work
 * @param {Record<string, string | null>} [attributes]
 */
export function button(words, work, attributes = {}) {
  const made = make("button", { type: "button", ...attributes }, words);
  made.addEventListener("click", () => work());
  return made;
}

/**
 * Make a picture of what can be adrift. Words stand beside it, so screen readers pass over it.
 * @param {string} name of a symbol of objects.svg
 */
export function picture(name) {
  const [made, symbol] = ["svg", "use"].map((kind) => document.createElementNS("http://www.w3.org/2000/svg", kind));
  symbol.setAttribute("href", `/assets/objects.svg#${name}`);
  made.setAttribute("class", "picture");
  made.setAttribute("aria-hidden", "true");
  made.append(symbol);
  return made;
}

/**
 * Ask the server: with a body by POST, without one by GET.
 * @template Answer
 * @param {string} path
 * @param {object} [body]
 * @returns {Promise<Answer>}
 * @throws {Rejected}
 */
export async function ask(path, body) {
  const posted = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  let answer;
  try {
    answer = await fetch(path, { ...(body === undefined ? {} : posted), credentials: "same-origin", cache: "no-store" });
  } catch {
    throw new Error("drift serve does not answer: it has ended or hangs. Start it again and open the address that it prints.");
  }
  const told = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
  if (!answer.ok) throw new Rejected(told.error, answer.status);
  if (!path.startsWith("/api/news/")) get("trouble").textContent = ""; // that is asked every second: errors stay readable
  if (told.mistakes) throw new Rejected(told.mistakes.join("\n"), 422);
  return told;
}

/**
 * Return a function that shows its errors on top of the page, and then returns null.
 * @template {any[]} Given
 * @template Found
 * @param {(...given: Given) => Found | Promise<Found>} work
 * @returns {(...given: Given) => Promise<Found | null>}
 */
export function guarded(work) {
  return async (...given) => {
    try {
      return await work(...given);
    } catch (error) {
      get("trouble").textContent = error instanceof Error ? error.message : String(error);
      return null;
    }
  };
}

/** @param {Job} job @returns {string[]} what drift says is wrong */
export const complaint_lines = (job) => job.lines.filter((line) => line.startsWith("drift: ")).map((line) => line.slice(7));

/**
 * Return a time without its seconds: 2026-11-21 18:30Z.
 * @param {string} iso
 */
export function when(iso) {
  return iso.replace("T", " ").replace(/:\d\dZ?$/, "") + (iso ? "Z" : "");
}

/** @param {number} size [bytes] */
export function bytes(size) {
  if (size < 1e3) return `${size} B`;
  return size < 1e6 ? `${Math.round(size / 1e3)} kB` : `${(size / 1e6).toFixed(1)} MB`;
}

/** @param {number} seconds */
export function span(seconds) {
  return seconds < 90 ? `${Math.round(seconds)} s` : `${Math.round(seconds / 60)} min`;
}

/**
 * Return the address of a file of a run.
 * @param {string} run
 * @param {string} key
 * @param {string} name
 */
export function file_of(run, key, name) {
  return `/runs/${encodeURIComponent(run)}/${key}/${encodeURIComponent(name)}`;
}
