"use strict";
// Number formats, and tables. All text is inserted as text, never as markup.
const MONTHS = ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"];

function element(kind, words = "", options = {}) {
  const made = document.createElement(kind);
  if (words !== "") made.textContent = words;
  for (const [name, value] of Object.entries(options)) made.setAttribute(name, value);
  return made;
}

function two(number) {
  return String(number).padStart(2, "0");
}

// 211830ZNOV26
function group(epoch) {
  const when = new Date(epoch * 1000), year = when.getUTCFullYear();
  const short = year >= 2000 && year < 2100 ? two(year % 100) : String(year).padStart(4, "0");
  return `${two(when.getUTCDate())}${two(when.getUTCHours())}${two(when.getUTCMinutes())}Z${MONTHS[when.getUTCMonth()]}${short}`;
}

// Seconds since 1970 of an ISO time; NaN for an empty one.
function epoch(text) {
  return text ? Date.parse(text) / 1000 : NaN;
}

// 28-42.0N 087-30.0W
function position([lon, lat]) {
  const east = near(lon, 0);
  const angle = (value, digits, positive, negative) => {
    const tenths = Math.round(Math.abs(value) * 600);
    const minutes = ((tenths % 600) / 10).toFixed(1).padStart(4, "0");
    return `${String(Math.floor(tenths / 600)).padStart(digits, "0")}-${minutes}${value >= 0 ? positive : negative}`;
  };
  return `${angle(lat, 2, "N", "S")} ${angle(east, 3, "E", "W")}`;
}

function significant(value, digits = 3) {
  if (value === 0) return "0";
  const magnitude = Math.abs(value);
  if (magnitude < 1e-4 || magnitude >= 1e9) return value.toExponential(digits - 1);
  return Number(value.toPrecision(digits)).toLocaleString("en", { maximumFractionDigits: 12 });
}

// The rule of geo.notation.percent.
function percent(value) {
  if (value <= 0) return "0 %";
  if (value >= 1 - 1e-9) return "100 %";
  const text = (100 * value).toFixed(1);
  if (text === "0.0") return "< 0.1 %";
  return text === "100.0" ? "> 99.9 %" : `${text} %`;
}

// Format by the third member of a column; "words" and "time" are left-aligned.
const FORMS = {
  words: value => value === true ? "yes" : value === false ? "no" : String(value),
  time: value => group(epoch(value)),
  share: value => percent(Number(value)),
  number: value => significant(Number(value)),
  stated: value => Number(Number(value).toPrecision(12)).toLocaleString("en", { maximumFractionDigits: 12 }), // as stated in the case
  count: value => Math.round(Number(value)).toLocaleString("en"),
  nmi2: value => `${significant(Number(value))} nmi²`,
  factor: value => `× ${significant(Number(value))}`,
};
const LEFT = new Set(["words", "time"]);

function written(value, form) {
  const nothing = value === undefined || value === null || value === "";
  return nothing || (!LEFT.has(form) && !Number.isFinite(Number(value))) ? "–" : FORMS[form](value);
}

const WHOLE = 400; // most rows shown of a table; the file has all

// A leaf's table. file: result of unpack.table, null if the leaf has its own rows; picked(epoch): called when a row with a time is chosen.
function tabled(leaf, file, picked) {
  const place = file ? leaf.columns.map(([name]) => file.header.indexOf(name)) : leaf.columns.map((_, k) => k);
  const timed = file && leaf.by_time ? file.header.indexOf(leaf.by_time) : -1;
  let rows = file ? file.rows : leaf.rows;
  for (const [name, value] of Object.entries(leaf.where)) {
    const column = file.header.indexOf(name);
    const wanted = new Set([value].flat()); // a value, or a list of allowed values
    rows = rows.filter(row => wanted.has(row[column]));
  }
  const made = element("table"), head = element("tr"), body = element("tbody");
  const more = rows.length > WHOLE ? ` The first ${WHOLE} of ${rows.length.toLocaleString("en")} rows; ${leaf.file} has all.` : "";
  if (leaf.note || more) made.append(element("caption", `${leaf.note}${more}`));
  for (const [, header, form] of leaf.columns) head.append(element("th", header, { scope: "col", class: LEFT.has(form) ? "words" : "" }));
  for (const row of rows.slice(0, WHOLE)) {
    const line = element("tr");
    leaf.columns.forEach(([, , form], k) => {
      const kind = k ? "td" : "th", options = { class: LEFT.has(form) ? "words" : "" };
      line.append(element(kind, written(row[place[k]], form), k ? options : { ...options, scope: "row" }));
    });
    if (timed >= 0) {
      const when = epoch(row[timed]);
      line.dataset.time = when;
      line.addEventListener("click", () => picked(when));
    }
    body.append(line);
  }
  const top = element("thead");
  top.append(head);
  made.append(top, body);
  const wide = element("div", "", { class: "wide", tabindex: "0", role: "region", "aria-label": leaf.title });
  wide.append(made);
  return { node: wide, rows: rows.length };
}
