// Run: the first map at once, and in its place, when the job ends, the result of the full run.
import { changes } from "./changes.js";
import { opened } from "./editor.js";
import { first_map } from "./form.js";
import { ask, button, get, guarded } from "./kit.js";
import * as sea from "./map.js";
import { chosen_scenario, clear_result, show_result } from "./results.js";
import { close_washup, open_washup } from "./washup.js";

const PATIENCE = 3000; // [ms] that the full run waits for the first map: both need the same cores
/** @typedef {{job: number, first: Sketch | null, told: Shown | null, scenario: string | null}} Refined */
let current = /** @type {Refined | null} */ (null); // the run whose result is to be shown

/**
 * Make the first map of the open case, and start its full run.
 * @param {() => Promise<Job>} start
 */
export async function begin_run(start) {
  const scenario = chosen_scenario(); // of the result before
  clear_result();
  const mine = /** @type {Refined} */ ({ job: 0, first: null, told: sea.shown.told, scenario });
  const map = first_map().then((first) => {
    if (first) Object.assign(mine, { first, told: first });
  });
  await Promise.race([map, new Promise((done) => setTimeout(done, PATIENCE))]);
  const job = await start();
  mine.job = job.number;
  current = mine;
  return job;
}

/**
 * Follow the run whose first map is shown; when it has ended, its result takes the place of the map.
 * @param {Job} job
 */
export const refine = guarded(async (/** @type {Job} */ job) => {
  const mine = current;
  if (!mine || job.number !== mine.job) return;
  const over = ["done", "failed", "cancelled"].includes(job.state);
  get("at-work").hidden = over;
  get("at-work").textContent = over ? "" : at_work(job);
  if (!over) return;
  current = null;
  if (job.state !== "done" || !job.out) {
    get("changed").textContent = `The full run ${job.state === "failed" ? "has failed: see Work" : "was cancelled"}. The map stays as it is.`;
    return;
  }
  /** @type {Folder} */
  const { runs } = await ask("/api/folder");
  const run = runs.find((one) => one.name === job.out);
  if (!run) return;
  const { first, told, scenario } = mine;
  if (sea.shown.told === told && opened.name === job.case) {
    const now = sea.shown.times[sea.shown.index];
    const result = await show_result(run, runs, { keep: Boolean(told), scenario });
    await stretches(run);
    const words = first && result && now !== undefined ? `, ${changes(first, result, now)}` : ".";
    get("changed").textContent = `The full run has ended: this is its result${words}`;
    return;
  }
  const show = button("Show it on the map", async () => {
    await show_result(run, runs);
    await stretches(run);
    get("changed").textContent = "";
  });
  get("changed").replaceChildren(`The full run of ${job.case} has ended. `, show);
});

/**
 * Show the stretches of coast of a spill's result.
 * @param {Run} run
 */
async function stretches(run) {
  const files = run.files.map((one) => one.name);
  if (files.includes("washup.nc")) await open_washup(run.name, run.key, files);
  else close_washup();
}

/** @param {Job} job */
function at_work({ state, share, took }) {
  if (state === "waiting") return "The full run waits for the one before it.";
  if (share <= 0.05 || !took || took < 5) return "The full run is at work.";
  const left = Math.round((took * (1 - share)) / share);
  return `The full run is at work, about ${Math.floor(left / 60)}:${String(left % 60).padStart(2, "0")} left.`;
}
