"use strict";
// The map's projection on a sphere, centred on the run, so that no map has a seam at 180 degrees: Mercator, or, near a pole and
// for maps of half of the Earth or more, Lambert's azimuthal equal-area projection (Snyder 1987, eqs. 7-1 and 24-2 to 24-4, 20-14).
// With around, Mercator goes round the Earth: longitudes beyond 180 degrees are places beyond, and OpenLayers repeats the world.
const R = 6371008.8, RAD = Math.PI / 180, NMI = 1852;

function near(lon, middle) {
  return lon - 360 * Math.round((lon - middle) / 360);
}

function projected({ kind, lon: lon0, lat: lat0, around = false }) {
  const sin0 = Math.sin(lat0 * RAD), cos0 = Math.cos(lat0 * RAD);
  const mercator = {
    forward([lon, lat]) {
      const phi = Math.max(-89.5, Math.min(89.5, lat)) * RAD;
      return [R * RAD * ((around ? lon : near(lon, lon0)) - lon0), R * Math.log(Math.tan(Math.PI / 4 + phi / 2))];
    },
    inverse([x, y]) {
      return [lon0 + x / R / RAD, (2 * Math.atan(Math.exp(y / R)) - Math.PI / 2) / RAD];
    },
  };
  const azimuthal = {
    forward([lon, lat]) {
      const a = (lon - lon0) * RAD, sin = Math.sin(lat * RAD), cos = Math.cos(lat * RAD);
      const k = R * Math.sqrt(2 / Math.max(1e-9, 1 + sin0 * sin + cos0 * cos * Math.cos(a)));
      return [k * cos * Math.sin(a), k * (cos0 * sin - sin0 * cos * Math.cos(a))];
    },
    inverse([x, y]) {
      const rho = Math.hypot(x, y), c = 2 * Math.asin(Math.min(1, rho / (2 * R)));
      if (!rho) return [lon0, lat0];
      const lat = Math.asin(Math.max(-1, Math.min(1, Math.cos(c) * sin0 + (y * Math.sin(c) * cos0) / rho)));
      const lon = Math.atan2(x * Math.sin(c), rho * cos0 * Math.cos(c) - y * sin0 * Math.sin(c));
      return [lon0 + lon / RAD, lat / RAD];
    },
  };
  const chosen = kind === "mercator" ? mercator : azimuthal;
  const far = kind === "mercator" ? Math.PI * R : 2 * R;
  const projection = new ol.proj.Projection({
    code: "drift", units: "m", global: around,
    extent: [-far, -far, far, far], worldExtent: [lon0 - 180, kind === "mercator" ? -85 : -90, lon0 + 180, kind === "mercator" ? 85 : 90],
    getPointResolution: (resolution, point) => kind === "mercator" ? resolution / Math.cosh(point[1] / R) : resolution,
  });
  ol.proj.addProjection(projection);
  ol.proj.addCoordinateTransforms("EPSG:4326", projection, chosen.forward, chosen.inverse);
  return { projection, ...chosen, separable: kind === "mercator", around };
}

// Distance [m] and bearing [deg] from one position [deg] to another along a great circle.
function toward([lon1, lat1], [lon2, lat2]) {
  const a = lat1 * RAD, b = lat2 * RAD, l = (lon2 - lon1) * RAD;
  const y = Math.sin(l) * Math.cos(b), x = Math.cos(a) * Math.sin(b) - Math.sin(a) * Math.cos(b) * Math.cos(l);
  const z = Math.sin(a) * Math.sin(b) + Math.cos(a) * Math.cos(b) * Math.cos(l);
  return { distance: R * Math.atan2(Math.hypot(x, y), z), bearing: (Math.atan2(y, x) / RAD + 360) % 360 };
}
