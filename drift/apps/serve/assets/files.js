// Files that are dropped on the page or chosen: who takes them, and how they come into the folder.
import { opened } from "./editor.js";
import { ask, get, Rejected } from "./kit.js";

const LARGEST = 2 ** 20; // [bytes]
/** @type {{takes: (file: File) => boolean, work: (file: File) => unknown}[]} */
const takers = [];

/**
 * Have files that are dropped on the page passed to a function.
 * @param {{takes: (file: File) => boolean, work: (file: File) => unknown}} taker
 */
export function dropped(taker) {
  takers.push(taker);
}

/**
 * Save a file in the folder; one of that name that is there already is used.
 * @param {string} path of the request
 * @param {File} file
 * @param {HTMLElement} said where a note goes
 * @param {string} use what becomes of it
 */
export async function saved(path, file, said, use) {
  if (file.size > LARGEST) throw new Error(`${file.name} is larger than 1 MB; cut it down to the time that matters`);
  if (opened.name === null) throw new Error(`open a case first; ${use}`);
  said.textContent = "";
  try {
    await ask(path, { name: file.name, text: /\.nc$/i.test(file.name) ? await in_base64(file) : await file.text() });
  } catch (error) {
    if (!(error instanceof Rejected) || error.status !== 409) throw error;
    said.textContent = `${error.message}: the file of the folder is used.`;
  }
}

/** @param {File} file that is no text */
async function in_base64(file) {
  const data = new Uint8Array(await file.arrayBuffer());
  return btoa(Array.from(data, (one) => String.fromCharCode(one)).join(""));
}

document.addEventListener("dragover", (event) => {
  if (event.dataTransfer?.types.includes("Files")) event.preventDefault();
});
document.addEventListener("drop", (event) => {
  const file = event.dataTransfer?.files[0];
  if (!file) return;
  event.preventDefault();
  const taker = takers.find((one) => one.takes(file));
  if (taker) taker.work(file);
  else get("trouble").textContent = `${file.name} is no track: only GPX files (.gpx) can be dropped here, and CSV (.csv) and netCDF files (.nc) of the ship of a spill.`;
});
