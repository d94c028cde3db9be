// Who works here: what others do appears on the page, and guests look without changing.
import { changed, opened, say, text } from "./editor.js";
import { all, ask, button, get, guarded, make, when } from "./kit.js";

const EVERY = 1500; // [ms]
const own = {
  you: "",
  several: false, // whether the server has several users
  last: /** @type {number | null} */ (null), // number of the newest entry that this page knows
};

/**
 * Return the words for whose job this is: nothing if there is one user only.
 * @param {string} user
 */
export const by = (user) => (own.several && user ? ` by ${user}` : "");

/**
 * Ask again and again what was done.
 * @param {() => void} told called when anything was
 * @param {(name: string) => void} open opens a case again
 */
export function watch(told, open) {
  const look = guarded(async () => {
    try {
      /** @type {News} */
      const news = await ask(`/api/news/${own.last ?? 0}`);
      Object.assign(own, { you: news.you, several: news.several });
      if (news.guest) be_guest(news.you);
      const first = own.last === null;
      own.last = news.last;
      if (first || !news.entries.length) return;
      told();
      list_log();
      for (const entry of news.entries) if (entry.user !== own.you) hear(entry, open);
    } finally {
      setTimeout(look, EVERY);
    }
  });
  look();
}

/**
 * Return an entry of the log as a sentence.
 * @param {Entry} entry
 */
function sentence({ user, action, case: name, result }) {
  const more = [name ?? "", result && result !== name ? `(${result})` : ""].filter(Boolean).join(" ");
  return `${user || "Somebody"} ${action} ${more}`.trim();
}

/**
 * Say what somebody else has done; of the open case also beside its name.
 * @param {Entry} entry
 * @param {(name: string) => void} open
 */
function hear(entry, open) {
  get("news").textContent = `${sentence(entry)} (${when(entry.time).slice(11)})`;
  if (entry.action !== "saved" || entry.case !== opened.name || entry.digest === opened.digest) return;
  const name = entry.case;
  const yours = changed() ? " Your changes stay here, and cannot overwrite it." : "";
  say(`${entry.user || "Somebody"} has saved another version of this case.${yours} `, true);
  if (name) get("said").append(button("Open the new version", () => open(name)));
}

/** Show the end of the log if it is unfolded. */
export const list_log = guarded(async () => {
  if (!get("log-box").open) return;
  /** @type {{entries: Entry[], trouble: string}} */
  const { entries, trouble } = await ask("/api/log");
  const rows = entries.map((entry) => make("li", {}, make("small", {}, when(entry.time)), ` ${sentence(entry)}`));
  if (trouble) rows.unshift(make("li", { class: "wrong" }, trouble));
  get("log").replaceChildren(...(rows.length ? rows : [make("li", { class: "soft" }, "Nothing yet.")]));
});
get("log-box").addEventListener("toggle", list_log);

/** @param {string} name */
function be_guest(name) {
  if (document.body.classList.contains("guest")) return;
  document.body.classList.add("guest");
  get("news").textContent = `${name}, you are a guest: you can look, but not change.`;
  text.readOnly = true;
  for (const part of /** @type {HTMLFieldSetElement[]} */ (all("#form fieldset"))) part.disabled = true;
}
