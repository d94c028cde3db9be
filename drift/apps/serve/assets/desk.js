"use strict";
// The desk: lists, the editor, and jobs. Everything from the server or a case is inserted as text, never as markup.
const desk = (() => {
  const get = (id) => document.getElementById(id);
  const state = { name: null, digest: null, saved: "", jobs: new Map(), checkOf: null, busy: false, timer: 0, stopped: false };

  function make(kind, attributes = {}, ...inside) {
    const element = document.createElement(kind);
    for (const [name, value] of Object.entries(attributes)) {
      if (name === "onclick") element.addEventListener("click", value);
      else if (value !== null && value !== false) element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...inside.filter((one) => one !== null));
    return element;
  }

  async function ask(path, body) {
    const options = body === undefined ? {} : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
    let answer;
    try {
      answer = await fetch(path, { ...options, credentials: "same-origin", cache: "no-store" });
    } catch {
      throw new Error("drift serve does not answer: it has ended or hangs. Start it again and open the address that it prints.");
    }
    const told = await answer.json().catch(() => ({ error: `the server answered ${answer.status}` }));
    if (!answer.ok) throw Object.assign(new Error(told.error), { status: answer.status });
    get("trouble").textContent = "";
    if (told.mistakes) throw Object.assign(new Error(told.mistakes.join("\n")), { status: 422 });
    return told;
  }

  const guarded = (work) => async (...given) => {
    try {
      return await work(...given);
    } catch (error) {
      get("trouble").textContent = error.message;
      return null;
    }
  };

  // Times and sizes as text.
  const when = (iso) => iso.replace("T", " ").replace(/:\d\dZ?$/, "") + (iso ? "Z" : "");
  const bytes = (n) => (n < 1e3 ? `${n} B` : n < 1e6 ? `${Math.round(n / 1e3)} kB` : `${(n / 1e6).toFixed(1)} MB`);
  const span = (s) => (s < 90 ? `${Math.round(s)} s` : `${Math.round(s / 60)} min`);
  const fileOf = (run, key, name) => `/runs/${encodeURIComponent(run)}/${key}/${encodeURIComponent(name)}`;

  // --- lists -------------------------------------------------------------------------------------------------------------
  const show = guarded(async () => {
    const told = await ask("/api/folder");
    get("folder").textContent = told.folder;
    document.title = `drift: ${told.folder}`;
    const empty = (words) => [make("li", { class: "soft" }, words)];
    const cases = told.cases.map((one) =>
      make("li", {}, make("button", { type: "button", class: "link", onclick: () => open(one.name) }, one.name), " ", make("span", {}, one.title)));
    get("cases").replaceChildren(...(cases.length ? cases : empty("No case yet: start from one of those below, or write one.")));
    if (!cases.length) get("shipped-box").open = true;
    get("shipped").replaceChildren(...told.shipped.map((one) =>
      make("li", {}, make("button", { type: "button", onclick: () => copy(one.name), "aria-label": `Use a copy of ${one.name}` }, "Use a copy"), " ",
        make("span", { class: "name" }, one.name), " ", make("span", {}, one.title))));
    const runs = told.runs.map(runRow);
    get("runs").replaceChildren(...(runs.length ? runs : empty("No results yet.")));
  });

  function runRow(run) {
    const title = run.title || run.name;
    const file = (name, words) => make("a", { href: fileOf(run.name, run.key, name), target: "_blank", rel: "noopener noreferrer" }, words);
    const facts = [run.kind, run.start && `${when(run.start)} to ${when(run.end)}`, `made ${when(run.made)}`, run.took ? `in ${span(run.took)}` : "", run.name];
    return make("li", {},
      make("p", { class: "name" }, run.report ? file("report.html", title) : title),
      make("p", { class: "soft" }, facts.filter(Boolean).join(" · ")),
      ...run.warnings.map((line) => make("p", { class: "wrong" }, `Warning: ${line}`)),
      make("details", {}, make("summary", {}, `Files of ${run.name}`),
        make("ul", { class: "files" }, ...run.files.map((one) => make("li", {}, file(one.name, one.name), " ", make("small", {}, bytes(one.bytes)))))));
  }

  // --- the editor --------------------------------------------------------------------------------------------------------
  const text = get("text");
  const changed = () => state.name !== null && text.value !== state.saved;

  function number() {
    const count = text.value.split("\n").length;
    if (Number(get("numbers").dataset.count) !== count) {
      get("numbers").textContent = Array.from({ length: count }, (_, k) => k + 1).join("\n") + "\n\n";
      get("numbers").dataset.count = count;
    }
    get("numbers").scrollTop = text.scrollTop;
  }

  function place() {
    const before = text.value.slice(0, text.selectionStart).split("\n");
    get("where").textContent = `Line ${before.length}, column ${before[before.length - 1].length + 1}`;
  }

  function say(words, wrong = false) {
    get("said").textContent = words;
    get("said").className = wrong ? "wrong" : "";
  }

  function lay(name, words, digest) {
    Object.assign(state, { name, digest, saved: digest === null ? null : words, checkOf: null });
    text.value = words;
    for (const button of document.querySelectorAll("[data-tab]")) button.disabled = false;
    get("editor-title").textContent = name;
    get("checked").replaceChildren();
    say(digest === null ? "Not saved yet." : "");
    number();
    place();
    tab("form");
    get("editor").focus({ preventScroll: true });
    document.dispatchEvent(new CustomEvent("laid"));
  }

  function tab(name) {
    for (const button of document.querySelectorAll("[data-tab]")) button.setAttribute("aria-pressed", button.dataset.tab === name);
    for (const part of document.querySelectorAll("[data-in]")) part.hidden = !part.dataset.in.split(" ").includes(name);
    number();
  }

  // A text that the form has changed.
  function write(words) {
    text.value = words;
    number();
    place();
    say(changed() ? "Not saved yet." : "");
  }

  const leave = () => !changed() || window.confirm(`${state.name} has changes that are not saved. Leave them?`);

  const open = guarded(async (name) => {
    if (!leave()) return;
    const told = await ask(`/api/cases/${encodeURIComponent(name)}`);
    lay(told.name, told.text, told.digest);
  });

  const copy = guarded(async (name) => {
    if (!leave()) return;
    const told = await ask(`/api/shipped/${encodeURIComponent(name)}`, {});
    const case_ = await ask(`/api/cases/${encodeURIComponent(told.name)}`);
    lay(case_.name, case_.text, case_.digest);
    say("A copy, saved in the folder.");
    await show();
  });

  get("new").addEventListener("submit", (event) => {
    event.preventDefault();
    const given = get("new-name").value.trim();
    const plain = given.replace(/\.toml$/, "");
    get("new-said").textContent = plain ? "" : "A case needs a name: enter one, such as my_case, then press Write one.";
    get("new-name").setAttribute("aria-invalid", !plain);
    if (!plain) return get("new-name").focus();
    if (!leave()) return;
    lay(`${plain}.toml`, `title = ${JSON.stringify(plain.replaceAll("_", " "))}\n`, null); // JSON's escapes are TOML's too
    tab("text");
    text.focus();
  });

  get("begin").addEventListener("click", guarded(async () => {
    if (!leave()) return;
    const told = await ask("/api/form/new", {});
    const { cases } = await ask("/api/folder");
    const taken = new Set(cases.map((one) => one.name));
    const day = new Date().toISOString().slice(0, 10);
    let name = `search_${day}.toml`;
    for (let k = 2; taken.has(name); k++) name = `search_${day}-${k}.toml`;
    lay(name, told.text, null);
  }));

  const save = guarded(async () => {
    if (state.name === null) return false;
    if (state.digest !== null && !changed()) {
      say("Saved already.");
      return true;
    }
    const words = text.value;
    try {
      const told = await ask(`/api/cases/${encodeURIComponent(state.name)}`, { text: words, digest: state.digest });
      Object.assign(state, { digest: told.digest, saved: words });
      say("Saved.");
      await show();
      return true;
    } catch (error) {
      if (error.status === 409) {
        say(error.message + (state.digest === null ? ". Give it another name." : ". Copy what you need from here and open it again."), true);
      } else {
        say(error.message, true);
      }
      return false;
    }
  });

  const start = guarded(async (kind) => {
    if (state.busy) return;
    state.busy = true;
    try {
      if (!(await save())) return;
      const job = await ask("/api/jobs", { kind, case: state.name, digest: state.digest });
      if (kind === "check") {
        state.checkOf = job.number;
        get("checked").replaceChildren(make("p", {}, "Checking ..."));
        say("");
        tab("text");
      } else {
        say(`${kind} started: see Work, below.`);
      }
      poll();
    } finally {
      state.busy = false;
    }
  });

  function jump(line) {
    tab("text");
    const lines = text.value.split("\n");
    const first = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    text.focus();
    text.setSelectionRange(first, first + (lines[line - 1] ?? "").length);
    text.scrollTop = Math.max(0, (line - 4) * 20);
    place();
  }

  function complaint(words) {
    const found = words.match(/\bline (\d+)\b/);
    return make("li", { class: "wrong" }, words, ...(found ? [" ", make("button", { type: "button", onclick: () => jump(Number(found[1])) }, `Go to line ${found[1]}`)] : []));
  }

  const mistakes = (job) => job.lines.filter((line) => line.startsWith("drift: ")).map((line) => line.slice(7));

  function checked(job) {
    const wrong = mistakes(job);
    if (job.state === "done") {
      get("checked").replaceChildren(make("h3", {}, "Valid: this is how the case is interpreted"), make("pre", { tabindex: 0, role: "region", "aria-label": "How the case is interpreted" }, job.lines.join("\n")));
    } else if (job.state === "cancelled") {
      get("checked").replaceChildren(make("p", {}, "The check was cancelled."));
    } else {
      get("checked").replaceChildren(make("h3", {}, wrong.length === 1 ? "One mistake" : `${wrong.length} mistakes`),
        make("ul", { class: "rows" }, ...(wrong.length ? wrong : job.lines.slice(-5)).map(complaint)));
    }
  }

  const show_result = guarded(async (run, key) => {
    const answer = await fetch(fileOf(run, key, "contours.geojson"), { cache: "no-store" });
    if (!answer.ok) throw new Error(`${run} has no areas`);
    document.dispatchEvent(new CustomEvent("areas", { detail: { title: run, areas: await answer.json() } }));
  });

  // --- jobs --------------------------------------------------------------------------------------------------------------
  const NAMES = { check: "Check", run: "Forecast", plan: "Plan", origin: "Origin" };
  const STATES = { waiting: "waits", running: "runs", done: "done", failed: "failed", cancelled: "cancelled" };
  const over = (job) => ["done", "failed", "cancelled"].includes(job.state);
  const rows = new Map();

  function row(job) {
    const made = rows.get(job.number) ?? {
      item: make("li"), head: make("p", { class: "name" }), bar: make("progress", { max: 1, "aria-label": `Progress of ${job.case}` }), phase: make("span", { class: "soft" }),
      link: make("p", {}), wrong: make("ul", { class: "rows" }), log: make("pre", { class: "log", tabindex: 0, role: "region", "aria-label": `Log of ${job.case}` }),
      stop: make("button", { type: "button", "aria-label": `Cancel ${NAMES[job.kind]} of ${job.case}`, onclick: guarded(async () => { await ask(`/api/jobs/${job.number}/cancel`, {}); poll(); }) }, "Cancel"),
    };
    if (!rows.has(job.number)) {
      made.item.append(made.head, make("div", { class: "line" }, made.bar, made.phase, made.stop), made.link, made.wrong,
        make("details", {}, make("summary", {}, `Log of job ${job.number}`), made.log));
      rows.set(job.number, made);
    }
    const head = `${NAMES[job.kind]} of ${job.case}: ${STATES[job.state]}${job.took === null ? "" : `, ${span(job.took)}`}`;
    if (made.head.textContent !== head) made.head.textContent = head;
    made.bar.hidden = made.stop.hidden = over(job);
    if (job.state === "running" && job.share > 0) made.bar.value = job.share;
    else made.bar.removeAttribute("value");
    const left = job.share > 0.05 && job.took > 5 ? `, about ${span((job.took * (1 - job.share)) / job.share)} left` : "";
    made.phase.textContent = over(job) ? "" : job.phase + (job.share > 0 ? `, ${Math.round(100 * job.share)} %${left}` : "");
    const log = job.lines.join("\n");
    if (made.log.textContent !== log) made.log.textContent = log;
    if (job.state === "done" && job.out && !made.link.firstChild) {
      made.link.append(make("a", { href: fileOf(job.out, job.key, "report.html"), target: "_blank", rel: "noopener noreferrer" }, `Open the report of ${job.out}`));
      if (job.kind === "run") made.link.append(" ", make("button", { type: "button", onclick: () => show_result(job.out, job.key) }, "Areas on the map"));
    }
    if (job.state === "failed" && !made.wrong.firstChild) made.wrong.append(...mistakes(job).map(complaint));
    return made.item;
  }

  const poll = guarded(async () => {
    clearTimeout(state.timer);
    let wait = 15000;
    try {
      const { jobs } = await ask("/api/jobs");
      let ended = false;
      for (const job of jobs) {
        const before = state.jobs.get(job.number);
        if (over(job) && before && !over(before)) {
          ended = true;
          get("spoken").textContent = `${NAMES[job.kind]} of ${job.case}: ${STATES[job.state]}`;
        }
        if (job.number === state.checkOf && over(job)) {
          state.checkOf = null;
          checked(job);
        }
        state.jobs.set(job.number, job);
      }
      const shown = jobs.filter((job) => job.kind !== "check");
      const items = shown.map(row);
      const list = get("jobs");
      if (items.length !== list.children.length || items.some((item, k) => list.children[k] !== item)) list.replaceChildren(...items);
      get("jobs-box").hidden = shown.length === 0;
      if (ended) await show();
      if (jobs.some((job) => !over(job))) wait = 500;
    } finally {
      clearTimeout(state.timer);
      state.timer = setTimeout(poll, wait);
    }
  });

  // --- the page ----------------------------------------------------------------------------------------------------------
  const systemDark = window.matchMedia("(prefers-color-scheme: dark)");
  let chosen = "auto";
  function colour() {
    document.documentElement.dataset.theme = chosen === "auto" ? (systemDark.matches ? "dark" : "light") : chosen;
    get("theme").textContent = `Colours: ${chosen}`;
    get("theme").setAttribute("aria-label", `Colours: ${chosen === "auto" ? "as the system's" : chosen}`);
    document.dispatchEvent(new CustomEvent("colours"));
  }
  systemDark.addEventListener("change", colour);
  get("theme").addEventListener("click", () => {
    const order = systemDark.matches ? ["auto", "light", "dark"] : ["auto", "dark", "light"];
    chosen = order[(order.indexOf(chosen) + 1) % 3];
    colour();
  });
  text.addEventListener("input", () => { number(); place(); say(changed() ? "Not saved yet." : ""); });
  text.addEventListener("scroll", () => { get("numbers").scrollTop = text.scrollTop; });
  for (const event of ["keyup", "click", "select"]) text.addEventListener(event, place);
  get("save").addEventListener("click", save);
  for (const button of document.querySelectorAll("[data-tab]")) button.addEventListener("click", () => tab(button.dataset.tab));
  tab("cases");
  for (const button of document.querySelectorAll("button[data-kind]")) button.addEventListener("click", () => start(button.dataset.kind));
  document.addEventListener("keydown", (event) => {
    if ((event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "s" && state.name !== null) {
      event.preventDefault();
      save();
    }
  });
  window.addEventListener("beforeunload", (event) => { if (changed()) event.preventDefault(); });
  document.addEventListener("visibilitychange", () => { if (!document.hidden) { show(); poll(); } });
  colour();
  show();
  poll();
  return { ask, guarded, make, state, write, complaint, text, show };
})();
