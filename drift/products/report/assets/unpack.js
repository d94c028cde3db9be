"use strict";
// Arrays, files and tables as drift/products/report/packed.py wrote them.
const unpack = (() => {
  async function bytes(text) {
    const raw = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
    const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  async function words(text) {
    return new TextDecoder().decode(await bytes(text));
  }

  async function floats(text) {
    return new Float32Array((await bytes(text)).buffer);
  }

  // One map of bytes, each stored as the difference from the one above it, modulo 256: {row, column, rows, columns, values}.
  async function frame([row, column, rows, columns, text]) {
    const values = rows * columns ? await bytes(text) : new Uint8Array(0);
    for (let k = columns; k < values.length; k++) values[k] = (values[k] + values[k - columns]) & 255;
    return { row, column, rows, columns, values };
  }

  // The value of a byte in a map of densities or of shares.
  function density(scale, q) {
    return q ? scale.most * 10 ** (scale.decades * ((q - 1) / (scale.levels - 1) - 1)) : 0;
  }
  function share(scale, q) {
    return q ? 1 - (q - 1) / (scale.levels - 1) : 1;
  }

  // RFC 4180: {header: [name], rows: [[text]]}.
  function table(text) {
    const rows = [[""]];
    let quoted = false;
    for (let k = 0; k < text.length; k++) {
      const letter = text[k], row = rows[rows.length - 1], last = row.length - 1;
      if (quoted) {
        if (letter !== '"') row[last] += letter;
        else if (text[k + 1] === '"') { row[last] += '"'; k++; }
        else quoted = false;
      }
      else if (letter === '"') quoted = true;
      else if (letter === ",") row.push("");
      else if (letter === "\n") rows.push([""]);
      else if (letter !== "\r") row[last] += letter;
    }
    if (rows[rows.length - 1].length === 1 && !rows[rows.length - 1][0]) rows.pop();
    return { header: rows[0] || [], rows: rows.slice(1) };
  }

  // Rings of land, as steps of 1e-4 degrees from the middle of the box: [[ring of [lon, lat]]].
  function land(polygons, middle) {
    return polygons.map(rings => rings.map(steps => {
      const ring = [];
      let lon = 0, lat = 0;
      for (let k = 0; k < steps.length; k += 2) {
        lon += steps[k];
        lat += steps[k + 1];
        ring.push([middle + lon * 1e-4, lat * 1e-4]);
      }
      return ring;
    }));
  }

  return { bytes, words, floats, frame, density, share, table, land };
})();
