// How near the layout is to the best that any could be, and where fiducials tell most: of all but where free beads are,
// so both stand still while beads are dragged, and only the design's own number moves against them.

import { computed, effect, signal } from "@preact/signals";
import type { components } from "../../../openapi/typescript/tailstack";
import { askWhenQuiet, current, refused, send } from "./api";
import { freesBeads, nameOf } from "./beads";
import { answering, known } from "./readings";
import { design, gesture, type Json } from "./state";
import { mm, sign } from "./words";

type Validation = components["schemas"]["Validation"];
const QUIET = 800; // ms without a change, after which it is asked for

/** The design without where its free beads are; empty where none is free. */
const frame = computed(() => {
  const asked = design.value?.optimise, points: Json[] = Array.isArray(design.value?.fiducials?.points) ? design.value.fiducials.points : [];
  if (!freesBeads(asked)) return "";
  const own = Array.isArray(asked.regions) ? asked.regions.flatMap((each: Json) => each?.fiducials ?? []) : null, fixed: Json[] = Array.isArray(asked.fixed) ? asked.fixed : [];
  const isFree = (label: Json) => (own ? own.includes(label) : !fixed.includes(label));
  const rest = points.map((point, k) => (isFree(nameOf(point, k)) ? { ...point, position_mm: null } : point));
  return JSON.stringify({ ...design.value, fiducials: { ...design.value.fiducials, points: rest } });
});
const answered = signal<{ frame: string; found: Validation | null } | null>(null);
const found = computed(() => (frame.value && answered.value?.frame === frame.value ? answered.value.found : null));
/** Whether there is, or will be, something to say. */
export const mayBound = computed(() => frame.value !== "");
export const worthy = computed(() => found.value?.places ?? []);

effect(() => {
  const asked = frame.value;
  if (!asked || !current.value || refused.value || gesture.value.length || answered.peek()?.frame === asked) return;
  const sent = design.value;
  return askWhenQuiet(QUIET, async (left) => {
    const response = await send("POST", "/v1/validations", { design: sent, bound: true }, {}, left).catch(() => null);
    if (response && !left.aborted) answered.value = { frame: asked, found: response.ok ? await response.json() : null };
  });
});

/** What is proven of the requirement that decides, in short and in all its words; null where nothing is. */
export const best = computed(() => {
  const check = answering(known.value), bound = found.value?.bounds.find(({ requirement }) => requirement === check?.requirement), least = bound?.lower_bound_mm;
  if (!check || !bound || least == null) return null;
  const gap = 100 * (check.value / least - 1), none = `none below ${mm(Math.floor(1000 * least) / 1000, 3)}${sign(check.unit)}`;
  const near = gap < 0 ? "Outside of what is asked for, and better than any layout within" : `Within ${gap < 0.1 ? "0.1" : Number(gap.toPrecision(2))} % of the best possible layout`;
  return { words: `${near}: ${none}.`, whole: bound.statement };
});
