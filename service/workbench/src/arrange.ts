// Where several beads come to when they are mirrored, turned or set on a circle together.  All in con, mm.

import { across, add, cross, dot, unit, type Vector } from "./geometry";

/** A plane through a point with a normal, or an axis through it along a direction of any length. */
export interface Line {
  point: Vector;
  along: Vector;
}
const DEGREE = Math.PI / 180;

/** Across the plane through the point, normal to the line. */
export function mirrored(position: Vector, plane: Line): Vector {
  const normal = unit(plane.along);
  return add(position, normal, -2 * dot(add(position, plane.point, -1), normal));
}

/** About the line, right-handed (Rodrigues). */
export function turned(position: Vector, axis: Line, degrees: number): Vector {
  const along = unit(axis.along), from = add(position, axis.point, -1), [c, s] = [Math.cos(degrees * DEGREE), Math.sin(degrees * DEGREE)];
  const side = cross(along, from), up = dot(along, from) * (1 - c);
  return add(axis.point, from.map((v, k) => v * c + side[k] * s + along[k] * up) as Vector);
}

/** At equal angles on one circle about the line, in the order in which they stand: its radius and height are the means, and
 * it is turned so that the squares of what the beads move are least. */
export function onCircle(positions: readonly Vector[], axis: Line): Vector[] {
  const along = unit(axis.along), first = across(along), second = cross(along, first);
  const from = positions.map((position) => add(position, axis.point, -1)), flat = from.map((v) => [dot(v, first), dot(v, second), dot(v, along)]);
  const mean = (values: number[]) => values.reduce((sum, v) => sum + v, 0) / values.length, count = positions.length, step = (2 * Math.PI) / count;
  const radius = mean(flat.map(([x, y]) => Math.hypot(x, y))), height = mean(flat.map(([, , z]) => z)), angles = flat.map(([x, y]) => Math.atan2(y, x));
  const order = angles.map((_, k) => k).sort((a, b) => angles[a] - angles[b]), rank = order.reduce<number[]>((ranks, k, n) => Object.assign(ranks, { [k]: n }), Array(count).fill(0));
  const off = angles.map((angle, k) => angle - step * rank[k]), weighed = (of: (angle: number) => number) => mean(off.map((angle, k) => Math.hypot(...flat[k].slice(0, 2)) * of(angle))), begin = Math.atan2(weighed(Math.sin), weighed(Math.cos));
  return rank.map((n) => [0, 1, 2].map((k) => axis.point[k] + radius * (Math.cos(begin + step * n) * first[k] + Math.sin(begin + step * n) * second[k]) + height * along[k]) as Vector);
}

/** How often a turn is repeated until the circle is full; once where it never is. */
export const repeats = (degrees: number) => (Math.abs(360 / degrees - Math.round(360 / degrees)) < 1e-9 ? Math.max(1, Math.abs(Math.round(360 / degrees)) - 1) : 1);

/** Labels as those of the beads that are copied, with numbers that none has. */
export function labelsLike(labels: readonly string[], taken: readonly string[]): string[] {
  const used = new Set(taken);
  return labels.map((label) => {
    const stem = /^(.*?)\d*$/s.exec(label)![1] || "F";
    let n = 1;
    while (used.has(`${stem}${n}`)) n += 1;
    used.add(`${stem}${n}`);
    return `${stem}${n}`;
  });
}
