// What the searches of a case and of a plan look like on the map: shapes that the server has computed.
import { chart, map } from "./map.js";

/** @returns {Theme} */
const theme = () => (document.documentElement.dataset.theme === "dark" ? "dark" : "light");

/**
 * Return a colour of graded shapes, from the least (0) to the most.
 * @param {number} shade
 */
export const shade_of = (shade) => (theme() === "dark" ? [...SEQUENCE].reverse() : SEQUENCE)[shade];

/**
 * Make a layer of the map whose shapes have a look and a label.
 * @param {number} order
 */
export function layer_of(order) {
  const source = new ol.source.Vector({ wrapX: true });
  const layer = new ol.layer.Vector({
    source,
    zIndex: order,
    declutter: true, // names only: a symbol always stays
    updateWhileAnimating: true,
    style: (feature) => {
      const shade = /** @type {number | undefined} */ (feature.get("shade"));
      const colour = shade === undefined ? undefined : shade_of(shade);
      const now = { theme: theme(), strong: Boolean(feature.get("strong")), label: feature.get("label"), width: feature.get("width"), colour };
      const look = feature.get("look");
      return now.label ? [...styled(look, now), ...titled(look, now)] : styled(look, now);
    },
  });
  chart.addLayer(layer);
  return { source, layer };
}

/**
 * Return points [deg] on the map, without a jump at 180 degrees.
 * @param {Point[]} points
 * @param {number} [about] longitude that the first is near
 */
export function on_map(points, about = 0) {
  let before = near(points[0]?.[0] ?? 0, about);
  return points.map(([lon, lat]) => {
    before = near(lon, before);
    const [x, y] = map.forward([0, lat]);
    return [x + R * RAD * before, y];
  });
}

/**
 * Return a shape of the map.
 * @param {"polygon" | "line" | "point"} kind
 * @param {Point[]} points
 * @param {Record<string, unknown>} properties look, label and more
 */
export function shape(kind, points, properties) {
  const placed = on_map(points);
  const geometry = kind === "polygon" ? new ol.geom.Polygon([placed])
    : kind === "line" ? new ol.geom.LineString(placed)
      : new ol.geom.Point(placed[0]);
  const feature = new ol.Feature(/** @type {Geometry} */ (geometry));
  feature.setProperties(properties, true);
  return feature;
}

/**
 * Return the shapes of a search: its outline and its legs.
 * @param {Searched} one
 * @param {{outline: string, legs: string, label: string, strong?: boolean, more?: Record<string, unknown>}} looks
 */
export function search_shapes(one, { outline, legs, label, strong = false, more = {} }) {
  const made = one.legs.map(({ searching, points }) => shape("line", points, { look: searching ? legs : "transit", ...more }));
  if (one.outline) made.push(shape("polygon", one.outline, { look: outline, label, strong, ...more }));
  return made;
}
