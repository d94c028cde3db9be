// Winds and currents from providers: choose them, see how much it is, download in a job, and have the form read the files.
import { opened, say, text } from "./editor.js";
import * as form from "./form.js";
import { all, ask, button, complaint_lines, get, guarded, make } from "./kit.js";
import * as sources from "./sources.js";

const WORDS = { wind: "Wind from", current: "Current from" };
const own = {
  offered: false, // whether the providers are listed
  job: /** @type {number | null} */ (null), // that is followed
  again: /** @type {() => void} */ (() => {}), // has the page ask for the jobs at once
};
const place = get("fetch");
const told = make("div", { role: "status" });

/** @param {SourceName} what @returns {HTMLSelectElement} */
const choice = (what) => /** @type {HTMLSelectElement} */ (get(`fetch-${what}`));

const offer = guarded(async () => {
  if (own.offered) return;
  /** @type {{providers: Provider[]}} */
  const { providers } = await ask("/api/fetch/providers", {});
  own.offered = true;
  const rows = sources.SOURCES.map((what) => {
    const select = make("select", { id: `fetch-${what}` }, make("option", { value: "first" }, "the first provider that has it"));
    for (const one of providers.filter(({ quantity }) => quantity === what)) {
      const why = one.free ? "" : ": needs credentials, use drift fetch";
      select.append(make("option", { value: one.name, disabled: !one.free }, `${one.title}${one.resolution ? `, ${one.resolution}` : ""}${why}`));
    }
    select.append(make("option", { value: "" }, "keep what is set above"));
    select.addEventListener("change", () => told.replaceChildren());
    return make("p", {}, make("label", { for: select.id }, WORDS[what]), " ", select);
  });
  place.replaceChildren(...rows, make("p", {}, button("How much is it?", () => begin(true))), told);
});
get("fetch-box").addEventListener("toggle", () => {
  if (get("fetch-box").open) offer();
});

/** Ask for a job: one that says how much it is, or the download. */
const begin = guarded(async (/** @type {boolean} */ size_only) => {
  if (!(await form.settled()) || opened.name === null) return;
  /** @type {Partial<Record<SourceName, string | null>>} */
  const wanted = {};
  for (const what of sources.SOURCES) {
    const { value } = choice(what);
    if (value) wanted[what] = value === "first" ? null : value;
  }
  if (!Object.keys(wanted).length) {
    told.replaceChildren(make("p", {}, "Choose a provider of wind or current."));
    return;
  }
  told.replaceChildren(make("p", {}, size_only ? "Asking the providers ..." : "The download is a job: see Work, below."));
  try {
    /** @type {Job} */
    const job = await ask("/api/fetch", { text: text.value, name: opened.name, wanted, size_only });
    own.job = job.number;
    own.again();
  } catch (error) {
    told.replaceChildren(make("p", { class: "wrong" }, error instanceof Error ? error.message : String(error)));
  }
});

/**
 * Follow the job that was asked for last.
 * @param {Job} job
 */
export function follow(job) {
  if (job.number !== own.job || !["done", "failed", "cancelled"].includes(job.state)) return;
  own.job = null;
  if (job.state !== "done") {
    const wrong = complaint_lines(job);
    told.replaceChildren(...(wrong.length ? wrong : [`It was ${job.state}.`]).map((line) => make("p", { class: "wrong" }, line)));
  } else if (job.kind === "size") {
    told.replaceChildren(
      make("pre", { tabindex: 0, role: "region", "aria-label": "What would be downloaded" }, job.lines.join("\n")),
      make("p", {}, button("Fetch them", () => begin(false), { class: "main" })));
  } else {
    told.replaceChildren();
    if (opened.name === job.case && job.out) use(job.out);
  }
}

/**
 * Have the open case read the files of a download.
 * @param {string} files their folder
 */
export async function use(files) {
  const before = text.value;
  await form.work_on_text("wind", async () => {
    /** @type {{text: string}} */
    const made = await ask("/api/fetch/use", { text: text.value, files });
    return made.text;
  });
  if (text.value !== before) say(`The case now reads the files in ${files}. Not saved yet.`);
}

/** Begin with a case that was just opened. @param {() => void} again */
export function begin_case(again) {
  own.again = again;
  own.job = null;
  get("fetch-box").open = false;
  told.replaceChildren();
  for (const one of all("select", place)) /** @type {HTMLSelectElement} */ (one).value = "first";
}
