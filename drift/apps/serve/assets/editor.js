// The text of the open case, its line numbers, and the tabs of the panel.
import { all, ask, button, get, guarded, make, Rejected } from "./kit.js";

/** The open case: its name, the digest of the version read (null: never saved), and the text as it was saved. */
export const opened = {
  name: /** @type {string | null} */ (null),
  digest: /** @type {string | null} */ (null),
  saved: /** @type {string | null} */ (""),
};

export const text = get("text");

/** Whether the text has changes that are not saved. */
export const changed = () => opened.name !== null && text.value !== opened.saved;

/** Write the line numbers beside the text. */
function number() {
  const count = text.value.split("\n").length;
  if (Number(get("numbers").dataset.count) !== count) {
    get("numbers").textContent = Array.from({ length: count }, (_, k) => k + 1).join("\n") + "\n\n";
    get("numbers").dataset.count = String(count);
  }
  get("numbers").scrollTop = text.scrollTop;
}

/** Say where the cursor is. */
function place() {
  const before = text.value.slice(0, text.selectionStart).split("\n");
  get("where").textContent = `Line ${before.length}, column ${before[before.length - 1].length + 1}`;
}

/** Say whether the text is saved, and where the cursor is. */
function follow() {
  number();
  place();
  say(changed() ? "Not saved yet." : "");
}

/**
 * Say something about the case.
 * @param {string} words
 * @param {boolean} [wrong]
 */
export function say(words, wrong = false) {
  get("said").textContent = words;
  get("said").className = wrong ? "wrong" : "";
}

/**
 * Show one tab of the panel.
 * @param {string} name
 */
export function tab(name) {
  for (const one of all("[data-tab]")) one.setAttribute("aria-pressed", String(one.dataset.tab === name));
  for (const part of all("[data-in]")) part.hidden = !part.dataset.in?.split(" ").includes(name);
  number();
  get("panel").scrollTop = 0; // each has its own length
  if (get("panel").getBoundingClientRect().top < 0) get("panel").scrollIntoView(); // on a phone the page scrolls
}

/**
 * Say what the step "Search" lacks, and show the button that adds it; return false.
 * @param {string} words
 * @param {HTMLElement} adds
 */
export function lacks(words, adds) {
  tab("search");
  say(words, true);
  adds.closest("fieldset")?.scrollIntoView({ block: "center" });
  adds.focus({ preventScroll: true });
  get("spoken").textContent = words;
  return false;
}

/**
 * Open a case in the editor; a digest of null: it was never saved.
 * @param {string} name
 * @param {string} words
 * @param {string | null} digest
 */
export function lay(name, words, digest) {
  Object.assign(opened, { name, digest, saved: digest === null ? null : words });
  text.value = words;
  for (const one of /** @type {HTMLButtonElement[]} */ (all("[data-tab]"))) one.disabled = false;
  get("editor-title").textContent = name;
  get("checked").replaceChildren();
  follow();
  tab("form");
  get("editor").focus({ preventScroll: true });
}

/**
 * Take over a text that the form has changed.
 * @param {string} words
 */
export function write(words) {
  text.value = words;
  follow();
}

/** Return true if the case may be left: nothing is unsaved, or the user says so. */
export function leave() {
  return !changed() || window.confirm(`${opened.name} has changes that are not saved. Leave them?`);
}

/** Save the case; return true if it is saved now. */
export const save = guarded(async () => {
  if (opened.name === null) return false;
  if (opened.digest !== null && !changed()) {
    say("Saved already.");
    return true;
  }
  const words = text.value;
  try {
    /** @type {{digest: string}} */
    const told = await ask(`/api/cases/${encodeURIComponent(opened.name)}`, { text: words, digest: opened.digest });
    Object.assign(opened, { digest: told.digest, saved: words });
    say("Saved.");
    return true;
  } catch (error) {
    if (!(error instanceof Rejected)) throw error;
    const advice = opened.digest === null ? ". Give it another name." : ". Copy what you need from here and open it again.";
    say(error.message + (error.status === 409 ? advice : ""), true);
    return false;
  }
});

/**
 * Select a line of the text.
 * @param {number} line
 */
function jump(line) {
  tab("text");
  const lines = text.value.split("\n");
  const first = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
  text.focus();
  text.setSelectionRange(first, first + (lines[line - 1] ?? "").length);
  text.scrollTop = Math.max(0, (line - 4) * 20);
  place();
}

/**
 * Return a mistake as an item of a list, with a button to the line that it names.
 * @param {string} words
 */
export function complaint(words) {
  const line = words.match(/\bline (\d+)\b/)?.[1];
  const more = line ? [" ", button(`Go to line ${line}`, () => jump(Number(line)))] : [];
  return make("li", { class: "wrong" }, words, ...more);
}

text.addEventListener("input", follow);
text.addEventListener("scroll", () => {
  get("numbers").scrollTop = text.scrollTop;
});
for (const event of ["keyup", "click", "select"]) text.addEventListener(event, place);
for (const one of all("[data-tab]")) one.addEventListener("click", () => tab(one.dataset.tab ?? ""));
window.addEventListener("beforeunload", (event) => {
  if (changed()) event.preventDefault();
});
tab("cases");
