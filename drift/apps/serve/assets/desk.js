// The page: its lists, jobs, buttons and colours. The other modules have the editor, the form and the map.
import { show_charts } from "./charts.js";
import { complaint, lay, leave, opened, save as save_text, say, tab, text } from "./editor.js";
import * as fetched from "./fetch.js";
import { begin, in_words_of_form, is_spill, settled } from "./form.js";
import { all, ask, button, bytes, complaint_lines, file_of, get, guarded, make, span, when } from "./kit.js";
import { paint } from "./map.js";
import { by, watch } from "./people.js";
import { close_plan, open_plan } from "./plan.js";
import { export_part } from "./export.js";
import { begin_run, refine } from "./refine.js";
import { clear_result, show_result } from "./results.js";
import * as search from "./search.js";
import * as spill from "./spill.js";
import { close_washup, open_washup } from "./washup.js";

const own = {
  lists: /** @type {Map<string, string>} */ (new Map()), // as they were told last, by id
  jobs: /** @type {Map<number, Job>} */ (new Map()),
  check: /** @type {number | null} */ (null), // the job that checks the open case
  busy: false,
  timer: 0,
};

// --- lists ---------------------------------------------------------------------------------------------------------------
const show = guarded(async () => {
  /** @type {Folder} */
  const told = await ask("/api/folder");
  get("folder").textContent = told.folder;
  document.title = `drift: ${told.folder}`;
  list("cases", told.cases, case_row, "No case yet: New search begins one for a person, a boat or a spill. Below are templates and examples.");
  if (!told.cases.length) get("shipped-box").open = true;
  list("shipped", told.shipped, shipped_row, "");
  list("runs", told.runs, run_row, "No results yet.");
});

/**
 * Show a list. One that has not changed stays, with what the user has unfolded in it.
 * @template Row
 * @param {string} id
 * @param {Row[]} told
 * @param {(one: Row) => HTMLElement} row
 * @param {string} empty
 */
function list(id, told, row, empty) {
  const words = JSON.stringify(told);
  if (own.lists.get(id) === words) return;
  own.lists.set(id, words);
  get(id).replaceChildren(...(told.length ? told.map(row) : [make("li", { class: "soft" }, empty)]));
}

/** @param {Listed} one */
function case_row({ name, title }) {
  return make("li", {}, button(name, () => open(name), { class: "link" }), " ", make("span", {}, title));
}

/** @param {Listed} one */
function shipped_row({ name, title }) {
  const use = button("Use a copy", () => copy(name), { "aria-label": `Use a copy of ${name}` });
  return make("li", {}, use, " ", make("span", { class: "name" }, name), " ", make("span", {}, title));
}

/**
 * Return a link to a file of a run, which opens in another tab.
 * @param {string} address
 * @param {string} words
 */
function link(address, words) {
  return make("a", { href: address, target: "_blank", rel: "noopener noreferrer" }, words);
}

/** @param {Run} run */
function export_of(run) {
  const part = export_part(run);
  return part && make("details", { "data-changes": "" }, make("summary", {}, `Export ${run.name}`), part);
}

/** @param {Run} run */
function run_row(run) {
  const title = run.title || run.name;
  /** @param {string} name @param {string} words */
  const file = (name, words) => link(file_of(run.name, run.key, name), words);
  const facts = [
    run.kind,
    run.start && `${when(run.start)} to ${when(run.end)}`,
    `made ${when(run.made)}`,
    run.took ? `in ${span(run.took)}` : "",
    run.name,
  ];
  const mapped = ["forecast", "plan", "patrols"].includes(run.kind) && run.files.some((one) => one.name === "contours.geojson");
  const files = run.files.map((one) => make("li", {}, file(one.name, one.name), " ", make("small", {}, bytes(one.bytes))));
  return make("li", {},
    make("p", { class: "name" }, run.report ? file("report.html", title) : title,
      ...(mapped ? [" ", button("On the map", () => on_map(run.name), { "aria-label": `${run.name} on the map` })] : [])),
    make("p", { class: "soft" }, facts.filter(Boolean).join(" · ")),
    ...run.warnings.map((line) => make("p", { class: "wrong" }, `Warning: ${line}`)),
    ...(run.kind === "origin" ? [] : note_part(run.name)),
    export_of(run),
    make("details", {}, make("summary", {}, `Files of ${run.name}`), make("ul", { class: "files" }, ...files)));
}

/**
 * Return a button that copies a short text about a result, and the place where the text appears.
 * @param {string} run
 */
function note_part(run) {
  const place = make("pre", { class: "note", tabindex: 0, role: "region", "aria-label": `Short text about ${run}`, hidden: true });
  const said = make("span", { class: "soft", role: "status" });
  const copy_note = guarded(async () => {
    /** @type {{text: string}} */
    const { text: words } = await ask("/api/note", { run });
    place.textContent = words;
    place.hidden = false;
    // a browser lets pages copy only at addresses that it trusts, such as those of this machine
    const copied = await Promise.resolve(navigator.clipboard?.writeText(words).then(() => true)).catch(() => false);
    said.textContent = copied ? " Copied." : " Select the text and copy it.";
  });
  return [make("p", {}, button("Copy a short text", copy_note, { "aria-label": `Copy a short text about ${run}` }), said), place];
}

// --- cases ---------------------------------------------------------------------------------------------------------------
/**
 * Open a case in the editor and the form.
 * @param {string} name
 * @param {string} words
 * @param {string | null} digest
 */
function open_text(name, words, digest) {
  own.check = null;
  lay(name, words, digest);
  close_plan();
  clear_result();
  close_washup();
  fetched.begin_case(poll);
  search.begin();
  spill.begin();
  return begin();
}

const open = guarded(async (/** @type {string} */ name) => {
  if (leave()) await open_saved(name);
});

/** @param {string} name */
async function open_saved(name) {
  /** @type {CaseText} */
  const told = await ask(`/api/cases/${encodeURIComponent(name)}`);
  await open_text(told.name, told.text, told.digest);
}

const copy = guarded(async (/** @type {string} */ name) => {
  if (!leave()) return;
  /** @type {{name: string}} */
  const told = await ask(`/api/shipped/${encodeURIComponent(name)}`, {});
  await open_saved(told.name);
  say("A copy, saved in the folder.");
  await show();
});

get("new").addEventListener("submit", (event) => {
  event.preventDefault();
  const plain = get("new-name").value.trim().replace(/\.toml$/, "");
  get("new-said").textContent = plain ? "" : "A case needs a name: enter one, such as my_case, then press Write one.";
  get("new-name").setAttribute("aria-invalid", String(!plain));
  if (!plain) {
    get("new-name").focus();
    return;
  }
  if (!leave()) return;
  open_text(`${plain}.toml`, `title = ${JSON.stringify(plain.replaceAll("_", " "))}\n`, null); // JSON's escapes are TOML's too
  tab("text");
  text.focus();
});

get("begin").addEventListener("click", guarded(async () => {
  if (!leave()) return;
  /** @type {{text: string}} */
  const told = await ask("/api/form/new", {});
  /** @type {Folder} */
  const { cases } = await ask("/api/folder");
  const taken = new Set(cases.map((one) => one.name));
  const day = new Date().toISOString().slice(0, 10);
  let name = `search_${day}.toml`;
  for (let k = 2; taken.has(name); k++) name = `search_${day}-${k}.toml`;
  open_text(name, told.text, null);
}));

async function save() {
  if (!(await settled())) {
    say("A field of the form cannot be read: mend the one in red.", true);
    return false;
  }
  const saved = await save_text();
  if (saved) await show();
  return saved;
}

// --- jobs ----------------------------------------------------------------------------------------------------------------
const NAMES = { check: "Check", run: "Forecast", plan: "Plan", origin: "Origin", size: "Size of a download", fetch: "Winds and currents" };
const STATES = { waiting: "waits", running: "runs", done: "done", failed: "failed", cancelled: "cancelled" };
/** @param {Job} job */
const over = (job) => ["done", "failed", "cancelled"].includes(job.state);
/** @type {Map<number, ReturnType<typeof new_row>>} */
const rows = new Map();

/** @param {Job} job */
const started = (job) => `${NAMES[job.kind]} of ${job.case} started: see Work, below.`;

const start = guarded(async (/** @type {string} */ kind) => {
  if (own.busy) return;
  own.busy = true;
  try {
    await settled(); // a unit may just be written
    if (kind === "plan" && !(is_spill() ? spill : search).can_plan()) return;
    if (!(await save())) return;
    /** @returns {Promise<Job>} */
    const new_job = () => ask("/api/jobs", { kind, case: opened.name, digest: opened.digest });
    const job = kind === "run" ? await begin_run(new_job) : await new_job();
    if (kind === "check") {
      own.check = job.number;
      get("checked").replaceChildren(make("p", {}, "Checking ..."));
      say("");
      tab("text");
    } else {
      say(started(job));
    }
    await poll();
    if (kind === "plan" || kind === "origin") get("jobs-box").scrollIntoView({ block: "nearest" });
  } finally {
    own.busy = false;
  }
});

/**
 * Show what a check has found.
 * @param {Job} job
 */
function checked(job) {
  const place = get("checked");
  if (job.state === "done") {
    const told = make("pre", { tabindex: 0, role: "region", "aria-label": "How the case is interpreted" }, job.lines.join("\n"));
    place.replaceChildren(make("h3", {}, "Valid: this is how the case is interpreted"), told);
  } else if (job.state === "cancelled") {
    place.replaceChildren(make("p", {}, "The check was cancelled."));
  } else {
    const wrong = complaint_lines(job);
    const listed = (wrong.length ? wrong : job.lines.slice(-5)).map(complaint);
    const heading = wrong.length === 1 ? "One mistake" : `${wrong.length} mistakes`;
    place.replaceChildren(make("h3", {}, heading), make("ul", { class: "rows" }, ...listed));
  }
}

/**
 * Show a result on the map: its areas, and of a plan its sub-areas.
 * @param {string} name
 */
const on_map = guarded(async (/** @type {string} */ name) => {
  /** @type {Folder} */
  const { runs, cases } = await ask("/api/folder");
  const run = runs.find((one) => one.name === name);
  if (!run) throw new Error(`${name} is not in the folder any more`);
  const its_case = `${name.replace(/-plan(-\d+)?$/, "")}.toml`;
  if (["plan", "patrols"].includes(run.kind) && opened.name === null && cases.some((one) => one.name === its_case)) await open_saved(its_case);
  await show_result(run, runs);
  const files = run.files.map((one) => one.name);
  if (run.kind === "plan") await open_plan(run.name, run.key, files);
  else close_plan();
  if (files.includes("washup.nc")) await open_washup(run.name, run.key, files);
  else close_washup();
});

/**
 * Make the row of a job.
 * @param {Job} job
 */
function new_row(job) {
  const cancel = guarded(async () => {
    await ask(`/api/jobs/${job.number}/cancel`, {});
    poll();
  });
  const stop = button("Cancel", cancel, {
    "aria-label": `Cancel ${NAMES[job.kind]} of ${job.case}`,
    "data-changes": "",
  });
  const made = {
    item: make("li"),
    head: make("p", { class: "name" }),
    bar: make("progress", { max: 1, "aria-label": `Progress of ${job.case}` }),
    phase: make("span", { class: "soft" }),
    link: make("p", {}),
    wrong: make("ul", { class: "rows" }),
    log: make("pre", { class: "log", tabindex: 0, role: "region", "aria-label": `Log of ${job.case}` }),
    stop,
  };
  const log = make("details", {}, make("summary", {}, `Log of job ${job.number}`), made.log);
  made.item.append(made.head, make("div", { class: "line" }, made.bar, made.phase, made.stop), made.link, made.wrong, log);
  return made;
}

/**
 * Return the row of a job as it is now.
 * @param {Job} job
 */
function row(job) {
  const made = rows.get(job.number) ?? new_row(job);
  rows.set(job.number, made);
  const took = job.took ?? 0;
  const head = `${NAMES[job.kind]} of ${job.case}${by(job.user)}: ${STATES[job.state]}${job.took === null ? "" : `, ${span(took)}`}`;
  if (made.head.textContent !== head) made.head.textContent = head;
  made.bar.hidden = made.stop.hidden = over(job);
  if (job.state === "running" && job.share > 0) made.bar.value = job.share;
  else made.bar.removeAttribute("value");
  const left = job.share > 0.05 && took > 5 ? `, about ${span((took * (1 - job.share)) / job.share)} left` : "";
  made.phase.textContent = over(job) ? "" : job.phase + (job.share > 0 ? `, ${Math.round(100 * job.share)} %${left}` : "");
  const log = job.lines.join("\n");
  if (made.log.textContent !== log) made.log.textContent = log;
  const { out, key } = job;
  if (job.state === "done" && job.kind === "fetch" && out && !made.link.firstChild) {
    made.link.append(button("Use these files", () => (opened.name === null ? null : fetched.use(out)), {
      "aria-label": `Use the files in ${out} in the open case`,
      "data-changes": "",
    }));
  } else if (job.state === "done" && out && key && !made.link.firstChild) {
    made.link.append(link(file_of(out, key, "report.html"), `Open the report of ${out}`));
    if (job.kind === "run") made.link.append(" ", button("Areas on the map", () => on_map(out)));
    if (job.kind === "plan") made.link.append(" ", button("Plan on the map", () => on_map(out)));
  }
  if (job.state === "failed" && !made.wrong.firstChild) {
    const lines = complaint_lines(job);
    made.wrong.append(...(job.case === opened.name ? lines.map(in_words_of_form) : lines).map(complaint));
  }
  return made.item;
}

const poll = guarded(async () => {
  clearTimeout(own.timer);
  let wait = 15000;
  try {
    /** @type {{jobs: Job[]}} */
    const { jobs } = await ask("/api/jobs");
    const ended = jobs.filter(follow).length > 0;
    const shown = jobs.filter((job) => job.kind !== "check" && !(job.kind === "size" && over(job)));
    const items = shown.map(row);
    const place = get("jobs");
    if (items.length !== place.children.length || items.some((item, k) => place.children[k] !== item)) place.replaceChildren(...items);
    get("jobs-box").hidden = shown.length === 0;
    if (ended) await show();
    if (jobs.some((job) => !over(job))) wait = 500;
  } finally {
    clearTimeout(own.timer);
    own.timer = setTimeout(poll, wait);
  }
});

/**
 * Keep a job as it is now; return whether it has ended since it was kept last.
 * @param {Job} job
 */
function follow(job) {
  const before = own.jobs.get(job.number);
  const ended = over(job) && before !== undefined && !over(before);
  if (ended) get("spoken").textContent = `${NAMES[job.kind]} of ${job.case}: ${STATES[job.state]}`;
  if (ended && get("said").textContent === started(job)) say(`${NAMES[job.kind]} ${STATES[job.state]}: see Work, below.`, job.state === "failed");
  if (job.number === own.check && over(job)) {
    own.check = null;
    checked(job);
  }
  own.jobs.set(job.number, job);
  refine(job);
  fetched.follow(job);
  if (ended && job.state === "done" && job.kind === "plan" && job.case === opened.name && job.out) on_map(job.out);
  return ended;
}

// --- the page ------------------------------------------------------------------------------------------------------------
const system_dark = window.matchMedia("(prefers-color-scheme: dark)");
let chosen = "auto";
function colour() {
  document.documentElement.dataset.theme = chosen === "auto" ? (system_dark.matches ? "dark" : "light") : chosen;
  get("theme").textContent = `Colours: ${chosen}`;
  get("theme").setAttribute("aria-label", `Colours: ${chosen === "auto" ? "as the system's" : chosen}`);
  paint();
}
system_dark.addEventListener("change", colour);
window.matchMedia("(prefers-contrast: more)").addEventListener("change", colour);
get("theme").addEventListener("click", () => {
  const order = system_dark.matches ? ["auto", "light", "dark"] : ["auto", "dark", "light"];
  chosen = order[(order.indexOf(chosen) + 1) % 3];
  colour();
});
get("first").addEventListener("click", clear_result);
get("save").addEventListener("click", save);
for (const one of all("button[data-kind]")) one.addEventListener("click", () => start(one.dataset.kind ?? ""));
document.addEventListener("keydown", (event) => {
  if ((event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "s" && opened.name !== null) {
    event.preventDefault();
    save();
  }
});
document.addEventListener("visibilitychange", () => {
  if (document.hidden) return;
  show();
  poll();
});
colour();
show_charts();
show();
poll();
watch(() => {
  show();
  poll();
}, open);
