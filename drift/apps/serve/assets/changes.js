// What has changed between two forecasts of a case, in words: the first map and its full run, or a run and the one before.

const SHARES = [0.5, 0.95]; // of the areas that are compared
const LEAST = { move: 0.05, size: 0.02, share: 0.005 }; // [nmi], of the area, of the probability: less is no change
const WINDS = ["north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west"];

/**
 * Return the index of the output nearest to a time.
 * @param {Compared} one
 * @param {number} time [s since 1970]
 */
function nearest({ times }, time) {
  const off = times.map((own) => Math.abs(epoch(own) - time));
  return off.indexOf(Math.min(...off));
}

/**
 * Return the size of an area [nmi2] at an output; NaN: it has none.
 * @param {Compared} one
 * @param {number} k
 * @param {number} share
 */
function size({ times, areas }, k, share) {
  const found = areas.features.find(({ properties }) => {
    return epoch(properties.time) === epoch(times[k]) && Math.abs((properties.level ?? 0) - share) < 1e-9;
  });
  return found?.properties.area_nmi2 ?? NaN;
}

/** @param {number} value */
const digits = (value) => String(Number(value.toPrecision(value < 1 ? 1 : 2)));
/** @param {number} value */
const percent = (value) => `${(100 * value).toFixed(0)} %`;

/**
 * Return where the most likely place has gone.
 * @param {Likely | undefined} from
 * @param {Likely | undefined} to
 */
function moved(from, to) {
  if (!from || !to) return [];
  if (from.ashore !== to.ashore) return [`the most likely place is now ${to.ashore ? "ashore" : "afloat"}`];
  const { distance, bearing } = toward(from.at, to.at);
  const away = distance / NMI;
  if (away < LEAST.move) return ["the most likely place has not moved"];
  const wind = WINDS[Math.round(bearing / 45) % 8];
  return [`the most likely place moved ${digits(away)} nmi ${wind}`];
}

/**
 * Return what has changed at a time, as a sentence.
 * @param {Compared} before
 * @param {Compared} after
 * @param {number} time [s since 1970]
 */
export function changes(before, after, time) {
  const [i, k] = [nearest(before, time), nearest(after, time)];
  const found = moved(before.likely[i][0], after.likely[k][0]);
  for (const share of SHARES) {
    const [old, now] = [size(before, i, share), size(after, k, share)];
    if (!Number.isFinite(old + now)) continue;
    const words = `the ${percent(share)} area`;
    const same = Math.abs(now - old) <= LEAST.size * old || digits(old) === digits(now);
    found.push(same ? `${words} is still ${digits(now)} nmi²` : `${words} is ${digits(now)} instead of ${digits(old)} nmi²`);
  }
  for (const { name, probability } of after.scenarios) {
    const old = before.scenarios.find((one) => one.name === name)?.probability[i];
    const now = probability[k];
    if (old !== undefined && Math.abs(now - old) > LEAST.share && percent(now) !== percent(old)) {
      found.push(`${name} has ${percent(now)} instead of ${percent(old)}`);
    }
  }
  const [old, now] = [before.ashore[i], after.ashore[k]];
  if (Math.abs(now - old) > LEAST.share && percent(now) !== percent(old)) found.push(`${percent(now)} is ashore instead of ${percent(old)}`);
  const apart = Math.abs(epoch(before.times[i]) - epoch(after.times[k]));
  const when = group(epoch(after.times[k])) + (apart > 60 ? `, compared with ${group(epoch(before.times[i]))}` : "");
  return found.length ? `at ${when} ${found.join("; ")}.` : "there is nothing to compare.";
}
