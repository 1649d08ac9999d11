// Where the dots of fifty shots stand, and what they say: as in the report (service/tailstack_service/report/dots.py).

import type { Score } from "./api";
import { percent } from "./words";

export type FiftyShots = NonNullable<Score["fifty_shots"]>;

export const WIDE = 240, TALLEST = 40; // of the picture, of its highest heap
const FEWEST = 16, MOST = 400; // columns of dots

/** How many dots stand in each column, counted from the limit, so that none stands on both sides of it; what has no answer is in the last. */
export function heap({ values, limit }: FiftyShots, end: number, step: number): Map<number, number> {
  const last = Math.floor((end - limit) / step) - 1, found = new Map<number, number>();
  for (const value of values) {
    const column = value == null ? last : Math.ceil((value - limit) / step) - 1;
    found.set(column, (found.get(column) ?? 0) + 1);
  }
  return found;
}

/** One scale for several: its end, and the width of a dot on it. */
export function scaleOf(all: FiftyShots[]): { end: number; step: number } {
  const end = 1.02 * Math.max(1e-9, ...all.flatMap(({ values, limit }) => [...values.map((value) => value ?? 0), 1.25 * limit]));
  const fits = (columns: number) => Math.max(...all.flatMap((shots) => [...heap(shots, end, end / columns).values()])) * (WIDE / columns) <= TALLEST;
  let columns = FEWEST;
  while (columns < MOST && !fits(columns)) columns += 1;
  return { end, step: end / columns };
}

export function missWords({ exceedance_probability: beyond, limit, values }: FiftyShots): string {
  const misses = values.filter((value) => value == null || value > limit).length;
  return `${misses} of 50 shots ${misses === 1 ? "misses" : "miss"} the limit (${percent(beyond)})`;
}
