// Types of the page of drift serve: what the server answers, and what the modules use of the scripts of report.html, which are
// not modules. The types of OpenLayers are its own.
import type BaseLayerOf from "ol/layer/Base";
import type FeatureOf from "ol/Feature";
import type { FeatureLike as FeatureLikeOf } from "ol/Feature";
import type GeometryOf from "ol/geom/Geometry";
import type MapOf from "ol/Map";
import type ProjectionOf from "ol/proj/Projection";
import type VectorSourceOf from "ol/source/Vector";
import type StyleOf from "ol/style/Style";
import type { StyleLike as StyleLikeOf } from "ol/style/Style";
import type ViewOf from "ol/View";

declare global {
  // --- elements of desk.html that are more than an HTMLElement ---
  interface Elements {
    text: HTMLTextAreaElement;
    form: HTMLFormElement;
    new: HTMLFormElement;
    "shipped-box": HTMLDetailsElement;
    "log-box": HTMLDetailsElement;
    "new-name": HTMLInputElement;
    wanted: HTMLInputElement;
    picker: HTMLInputElement;
    slider: HTMLInputElement;
    object: HTMLSelectElement;
    scenario: HTMLSelectElement;
    story: HTMLSelectElement;
    since: HTMLInputElement;
    "search-object": HTMLSelectElement;
    "new-sortie": HTMLSelectElement;
    "new-contact": HTMLSelectElement;
    "new-track": HTMLInputElement;
    "ship-file": HTMLInputElement;
    kind: HTMLSelectElement;
    "stretch-class": HTMLSelectElement;
  }
  type ElementOf<Id extends string> = Id extends keyof Elements ? Elements[Id] : HTMLElement;

  // --- answers of the server ---
  type Point = [lon: number, lat: number]; // [deg]
  interface Listed { name: string; title: string }
  interface Run extends Listed {
    kind: string; start: string; end: string; made: string; took: number | null; warnings: string[]; report: boolean; key: string;
    files: { name: string; bytes: number }[];
  }
  interface Folder { folder: string; cases: Listed[]; shipped: Listed[]; runs: Run[] }
  interface Chart { name: string; attribution: string; least: number; most: number; bounds: [number, number, number, number] | null }
  interface CaseText { name: string; text: string; digest: string }
  interface Job {
    number: number; kind: "check" | "run" | "plan" | "origin"; case: string; digest: string; user: string; out: string | null; key: string | null;
    state: "waiting" | "running" | "done" | "failed" | "cancelled"; phase: string; share: number; took: number | null; lines: string[];
  }
  interface Entry { time: string; user: string; action: string; case: string | null; digest: string | null; result: string | null }
  interface News { you: string; guest: boolean; several: boolean; last: number; entries: Entry[] }
  type SourceName = "wind" | "current";
  interface SourceRow { time?: string; speed?: string; from?: string | number; toward?: string | number }
  interface Source extends SourceRow { kind: "" | "constant" | "table" | "files"; rows?: SourceRow[]; files?: string[] }
  type FieldValue = string | string[] | Source | null;
  interface Field { value?: FieldValue; read?: string | number | Point | Point[] | null; in_text?: boolean }
  interface Form { fields: Record<string, Field>; unknown: string[]; scenarios: number; spill: boolean }
  interface Message { message: string; field: string | null; line: number | null }
  interface DriftObject { name: string; description: string; level: number; words: string[] }
  interface Coast { features: { geometry: { coordinates: Point[][] } }[] }
  interface Areas { features: { properties: { time: string; level?: number; area_nmi2?: number }; geometry: { coordinates: Point[][][] } }[] }
  interface Likely { at: Point; ashore: boolean; share: number }
  interface Shown {
    areas: Areas; start?: string; times?: string[]; opens?: string | null; likely?: Likely[][]; looks?: string[];
    particles?: { lon: number[][]; lat: number[][]; status: number[][] };
  }
  interface Probabilities { scenarios: { name: string; probability: number[] }[]; ashore: number[] }
  interface Sketch extends Shown, Probabilities {
    title: string; number: number; words: string; warnings: string[]; statuses: string[]; washup: Washup | null; times: string[]; likely: Likely[][];
  }
  interface Compared extends Probabilities { times: string[]; likely: Likely[][]; areas: Areas }
  interface Place { at?: Point; error?: number; line?: Point[]; polygon?: Point[] } // [deg], [m]

  // --- the step "Search", plans and results ---
  type Value = string | number | boolean | string[] | number[] | null;
  interface Table { [key: string]: Value | Record<string, Value> }
  interface Change { field: string; value: FieldValue | Value | Table }
  type Values = Record<string, Value>;
  interface Row { values: Values; in_text: string[] }
  type Listed3 = "sortie" | "contact" | "unit";
  interface Searched {
    outline: Point[] | null; legs: { searching: boolean; points: Point[] }[]; start: string; end: string; period: string;
    track_nmi: number; legs_number: number; pod: number | null;
  }
  interface Searches {
    rows: Record<Listed3, Row[]>; plan: Row; search_objects: string[];
    shapes: { sortie: Record<string, Searched>; contact: Record<string, { shape: "point" | "region" | "line"; points: Point[] }[]>; unit: Record<string, Point> };
  }
  interface FieldSpec {
    key: string; label: string; kind?: "place" | "places" | "fixes" | "lines" | "range" | "degrees" | "number" | "choice" | "tick" | "file"; size?: number; hint?: string;
    choices?: [value: string, words: string][]; otherwise?: boolean;
  }
  interface PatternSpec { label: string; fields: FieldSpec[] }
  interface RowList {
    table: string; stem: string; empty: string; fields(values: Values): FieldSpec[]; inputs(prefix: string, row: Row): HTMLElement[];
    sign(row: Row): unknown; heading(row: Row, k: number): string[]; look: ((k: number) => void) | null;
  }
  interface Variant { id: string; words: string; fits(values: Values): boolean; fields: FieldSpec[]; begin(values: Values): Record<string, Value> }
  type FieldInput = HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement;
  interface RowTools {
    set(changes: Change[]): Promise<unknown>; pick(field: string, told: (at: string) => void, several: boolean): void; files(): string[];
  }
  interface Move { at: Point; turned: number } // [deg]
  interface PlannedArea extends Searched {
    name: string; unit: string; centre: Point; orientation: number; length_nmi: number; width_nmi: number; place: string; notes: string[]; pos: number;
  }
  interface Planned { run: string; areas: PlannedArea[]; total: number; objective: string; bound: number | null; warnings: string[] }
  interface MovedPlan { run: string; areas: (PlannedArea & { as_planned: number })[]; total: number; as_planned: number; took_ms: number }
  interface ResultOf extends Compared { words: string; statuses: string[]; particles: NonNullable<Shown["particles"]>; opens: string | null }

  // --- spills ---
  type SpillTable = "spill.class" | "spill.loss" | "find" | "patrol" | "patrol_unit";
  interface Spill {
    rows: Record<SpillTable, Row[]>; spill: Row;
    shapes: {
      track: Point[]; losses: { points: Point[]; period: string }[]; finds: Record<string, { at: Point; off_shore: number | null; mistake: string | null }>;
      patrols: Record<string, { points: Point[] }>; teams: Record<string, { at: Point; reach: number }>;
    };
  }
  interface Stretch { id: string; segment: number; name: string; at: Point; length_km: number; first: string | null; lines: Point[][] }
  interface PlannedPatrol {
    name: string; team: string; time: string; length_km: number; found: number; visits: { segment: number; name: string; lying: number; found: number }[];
  }
  interface Washup {
    run: string; times: string[]; classes: string[]; lost: number; ashore: [mean: number, low: number, high: number][]; expected: number[][][];
    low: number[][]; high: number[][]; probability: number[][]; number: number; stretches: Stretch[]; warnings: string[];
    finds: { name: string; at: Point; stretch: string; chance: number; odd: boolean }[]; patrols: PlannedPatrol[];
    plan: { found: number; found_se: number; bound: number } | null;
  }

  // --- scripts of report.html ---
  type Theme = "light" | "dark";
  type BaseLayer = BaseLayerOf;
  type FeatureLike = FeatureLikeOf;
  type Geometry = GeometryOf;
  type StyleLike = StyleLikeOf;
  type VectorSource = VectorSourceOf<FeatureOf<GeometryOf>>;
  interface Projected {
    projection: ProjectionOf; separable: boolean; around: boolean;
    forward(at: Point): number[];
    inverse(at: number[]): Point;
  }
  interface Look { theme: Theme; size?: number; opaque?: number; label?: string; strong?: boolean; width?: number; colour?: string }
  const SEQUENCE: string[];
  interface Leaf { layer: BaseLayerOf; nameplates: BaseLayerOf | null; every: FeatureOf[]; update(now: { time: number; theme: Theme }): void }
  const R: number, RAD: number, NMI: number;
  function near(lon: number, middle: number): number;
  function projected(given: { kind: "mercator"; lon: number; lat: number; around?: boolean }): Projected;
  function toward(from: Point, to: Point): { distance: number; bearing: number };
  function graticule(map: Projected, view: ViewOf, chart: MapOf): { paint(colours: { line: string; ink: string; halo: string }): void };
  function tinted(colour: string, share: number): string;
  function styled(look: string, now: Look): StyleOf[];
  function titled(look: string, now: Look): StyleOf[];
  function shapes(leaf: object, files: null, map: Projected, order: number): Leaf;
  function group(epoch: number): string;
  function epoch(text: string): number;
  function position(at: Point): string;

  // --- OpenLayers as one script ---
  const ol: {
    Feature: typeof import("ol/Feature").default;
    Map: typeof import("ol/Map").default;
    View: typeof import("ol/View").default;
    control: { ScaleLine: typeof import("ol/control/ScaleLine").default; defaults: typeof import("ol/control/defaults") };
    extent: typeof import("ol/extent");
    geom: {
      LineString: typeof import("ol/geom/LineString").default;
      Point: typeof import("ol/geom/Point").default;
      Polygon: typeof import("ol/geom/Polygon").default;
    };
    interaction: { Pointer: typeof import("ol/interaction/Pointer").default; Translate: typeof import("ol/interaction/Translate").default };
    layer: { Tile: typeof import("ol/layer/Tile").default; Vector: typeof import("ol/layer/Vector").default };
    source: { Vector: typeof import("ol/source/Vector").default; XYZ: typeof import("ol/source/XYZ").default };
    tilegrid: typeof import("ol/tilegrid");
    style: {
      Fill: typeof import("ol/style/Fill").default;
      Stroke: typeof import("ol/style/Stroke").default;
      Style: typeof import("ol/style/Style").default;
    };
  };
}
