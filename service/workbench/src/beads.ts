// The beads of the design on the page: which are chosen, how they are moved together, and what is wrong where they are.

import { computed, signal } from "@preact/signals";
import { answer, layout, refused } from "./api";
import { add, type Projection, project, rounded, type Vector } from "./geometry";
import { breaches, type Rules, settle } from "./keeping";
import { design, type Edit, gesture, type Json, picked, recall, remember, settled } from "./state";

export interface Bead {
  index: number;
  label: string;
  position: Vector;
}

/** What a point is called: by its place in the list, where it says nothing itself. */
export const nameOf = (point: Json, index: number): Json => point?.label ?? `F${index + 1}`;

export function beadsOf(data: Json): Bead[] {
  const points = data?.fiducials?.points;
  if (!Array.isArray(points)) return [];
  return points.flatMap((point: Json, index: number) => {
    const p = point?.position_mm;
    const sound = Array.isArray(p) && p.length === 3 && p.every((v: unknown) => typeof v === "number" && Number.isFinite(v));
    return sound ? [{ index, label: String(nameOf(point, index)), position: p as Vector }] : [];
  });
}

/** The fiducials that the page can move: those that the design lists point by point. */
export const beads = computed<Bead[]>(() => beadsOf(design.value));

/** Whether an optimisation may put beads elsewhere. */
export const freesBeads = (asked: Json): boolean => Boolean(asked?.box || asked?.region || asked?.regions);

// --- which are chosen ------------------------------------------------------------------------------------------------

export const adding = signal(false); // a press adds to what is chosen, as it does with Shift
export const toggle = (label: string) => (picked.value = picked.value.includes(label) ? picked.value.filter((each) => each !== label) : [...picked.value, label]);
/** Choose these, beside what is chosen or instead. */
export const pick = (labels: readonly string[], more: boolean) => (picked.value = [...(more ? picked.value.filter((each) => !labels.includes(each)) : []), ...labels]);
export const chosenBeads = computed(() => beads.value.filter(({ label }) => picked.value.includes(label)));
/** What is moved with a bead, in words. */
export const called = (label: string) => (picked.value.includes(label) && chosenBeads.value.length > 1 ? `${chosenBeads.value.length} beads` : label);

// --- moving them -----------------------------------------------------------------------------------------------------

const KEEPS = "tailstack.workbench.keeps";
export const locked = signal<readonly boolean[]>([false, false, false]);
export const keeps = signal(recall(KEEPS, true)); // spacing and zones
export const keepRules = (on: boolean) => remember(KEEPS, (keeps.value = on));
export const stopped = signal<string | null>(null); // why what is moved stays behind the pointer

/** What the design asks of where beads are: the optimiser's spacing and zones, and that balls do not overlap. */
export const rules = computed<Rules>(() => {
  const asked = design.value?.optimise, number = (value: Json, otherwise: number) => (typeof value === "number" ? value : otherwise);
  return { spacing_mm: Math.max(asked ? number(asked.min_spacing_mm, 10) : 0, number(design.value?.fiducials?.diameter_mm, 0)), zones: Array.isArray(asked?.keep_out) ? asked.keep_out : [], locked: locked.value };
});

export const placing = (index: number, position: Vector, digits = 3): Edit => ({ path: ["fiducials", "points", index, "position_mm"], value: rounded(position, digits) });

/** Edits that bring a bead, and what is chosen with it, to a place, or as near to it as what is locked and kept lets them;
 * null where it lets them nowhere near. */
export function movingTo(label: string, place: Vector, digits = 3): Edit[] | null {
  const all = beadsOf(settled.value), own = all.find((bead) => bead.label === label);
  if (!own) return null;
  const group = picked.value.includes(label) ? all.filter((bead) => picked.value.includes(bead.label)) : [own];
  const delta = add(place, own.position, -1).map((v, axis) => (locked.value[axis] ? 0 : v)) as Vector, places = group.map(({ position }) => add(position, delta));
  const { shift, why } = keeps.value ? settle(places, all.filter((bead) => !group.includes(bead)), rules.value) : { shift: [0, 0, 0] as Vector, why: null };
  stopped.value = why;
  return why ? null : group.map(({ index }, k) => placing(index, add(places[k], shift), digits));
}

// --- what is wrong where they are ------------------------------------------------------------------------------------

const MOST = 80; // beads of which every pair is looked at

/** By label, why a bead cannot be where it is: it leaves an image, lies over another, breaks what is kept, or the service
 * refuses the layout that a drag has made. */
export const wrong = computed<ReadonlyMap<string, string>>(() => {
  const found = new Map<string, string>(), all = beads.value, refusal = gesture.value.length ? refused.value : null;
  const note = (label: string, words: string) => found.has(label) || found.set(label, words);
  if (refusal?.status) for (const label of picked.value) note(label, refusal.errors[0].detail);
  (layout.value?.views ?? []).forEach((view, k) => {
    const sees: string[] | undefined = design.value?.views?.[k]?.sees, needs = answer.value?.score.views.find((each) => each.view === view.view)?.closest_pair_needs_px ?? 0;
    const images = all.filter(({ label }) => !sees || sees.includes(label)).map(({ label, position }) => ({ label, at: project(view.projection as Projection, position) }));
    images.forEach(({ label, at }, n) => {
      if (view.image_size_px && (!at || at.some((x, axis) => x < -0.5 || x > view.image_size_px![axis] - 0.5))) note(label, `outside the image of ${view.view}`);
      if (at && needs && images.length <= MOST) for (const other of images.slice(0, n)) if (other.at && Math.hypot(at[0] - other.at[0], at[1] - other.at[1]) < needs) {
        note(label, `over ${other.label} in ${view.view}`);
        note(other.label, `over ${label} in ${view.view}`);
      }
    });
  });
  if (keeps.value) for (const bead of chosenBeads.value) for (const { words } of breaches(bead.position, all.filter((other) => other !== bead), rules.value).slice(0, 1)) note(bead.label, words);
  return found;
});
