// What beads keep while they are moved: distances from one another, and zones in which none may be, as the optimiser has
// them (optimisation/regions.py).  All in con, mm.

import { across, add, dot, length, unit, type Vector } from "./geometry";

interface Round {
  radius_mm: number;
  inner_radius_mm?: number;
}
export interface Zone {
  name: string;
  clearance_mm?: number;
  box?: { min_mm: Vector; max_mm: Vector };
  cylinder?: Round & { base_mm: Vector; axis?: Vector; height_mm: number };
  ball?: Round & { centre_mm: Vector };
}
export interface Rules {
  spacing_mm: number; // 0: none
  zones: readonly Zone[];
  locked: readonly boolean[]; // axes along which nothing moves
}
interface Place {
  label: string;
  position: Vector;
}
/** How far a bead is from where a rule lets it be, and which way that is. */
interface Breach {
  mm: number;
  way: Vector;
  words: string;
}

const unitOr = (v: Vector, otherwise: Vector): Vector => (length(v) > 1e-12 ? unit(v) : otherwise);

/** The shortest way out of a zone with its clearance: each face is moved out by that; null outside it. */
export function wayOut(zone: Zone, point: Vector): Breach | null {
  const gap = zone.clearance_mm ?? 0, ways: { mm: number; way: Vector }[] = [];
  const round = ({ radius_mm: radius, inner_radius_mm: inner = 0 }: Round, from: Vector, otherwise: Vector) => {
    const far = length(from), way = unitOr(from, otherwise);
    ways.push({ mm: radius + gap - far, way });
    if (inner - gap > 0) ways.push({ mm: far - inner + gap, way: way.map((x) => -x) as Vector });
  };
  if (zone.box) {
    const { min_mm: low, max_mm: high } = zone.box;
    for (const k of [0, 1, 2]) for (const sign of [-1, 1]) {
      ways.push({ mm: gap + (sign < 0 ? point[k] - low[k] : high[k] - point[k]), way: [0, 1, 2].map((m) => (m === k ? sign : 0)) as Vector });
    }
  } else if (zone.ball) round(zone.ball, add(point, zone.ball.centre_mm, -1), [1, 0, 0]);
  else if (zone.cylinder) {
    const { base_mm: base, axis = [0, 0, 1], height_mm: height } = zone.cylinder, along = unitOr(axis, [0, 0, 1]), from = add(point, base, -1), up = dot(from, along);
    round(zone.cylinder, add(from, along, -up), across(along));
    ways.push({ mm: up + gap, way: along.map((x) => -x) as Vector }, { mm: height + gap - up, way: along });
  }
  const least = ways.reduce((a, b) => (b.mm < a.mm ? b : a), { mm: Infinity, way: [1, 0, 0] as Vector });
  return least.mm > 0 && ways.length ? { ...least, words: `in the zone ${zone.name}` } : null;
}

/** Which rules a place breaks, beside beads that stay; the worst first. */
export function breaches(position: Vector, others: readonly Place[], { spacing_mm, zones }: Rules): Breach[] {
  const near = others.flatMap((other) => {
    const from = add(position, other.position, -1), mm = spacing_mm - length(from);
    return mm > 1e-9 ? [{ mm, way: unitOr(from, [1, 0, 0]), words: `nearer than ${spacing_mm} mm to ${other.label}` }] : [];
  });
  return [...near, ...zones.flatMap((zone) => wayOut(zone, position) ?? [])].sort((a, b) => b.mm - a.mm);
}

const ROUNDS = 60, SURPLUS = 0.002; // mm that are kept beyond a rule: what is written is rounded

/** The shift by which all places together come to where the rules let them be, and where they do not, why. */
export function settle(places: readonly Vector[], others: readonly Place[], rules: Rules): { shift: Vector; why: string | null } {
  let shift: Vector = [0, 0, 0], why = "";
  for (let k = 0; k < ROUNDS; k += 1) {
    const [worst] = places.flatMap((place) => breaches(add(place, shift), others, rules)).sort((a, b) => b.mm - a.mm);
    if (!worst) return { shift, why: null };
    const free = worst.way.map((x, axis) => (rules.locked[axis] ? 0 : x)) as Vector, gain = dot(free, free);
    why = worst.words;
    if (gain < 0.01) break;
    shift = add(shift, free, (worst.mm + SURPLUS) / gain);
  }
  return { shift, why };
}
