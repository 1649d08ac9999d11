// Points in con (mm) and their images (px).  Only for drawing and dragging: every number on the page is the service's.

export type Vector = [number, number, number];
export type Pixel = [number, number];
export type Projection = number[][]; // 3 x 4: (x, y, z, 1) in con, mm -> (u w, v w, w)

export const dot = (a: readonly number[], b: readonly number[]) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export function cross(a: readonly number[], b: readonly number[]): Vector {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export const add = (a: readonly number[], b: readonly number[], factor = 1): Vector => [
  a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2],
];

export const rounded = (point: readonly number[], digits = 3): Vector =>
  point.map((value) => Number(value.toFixed(digits)) + 0) as Vector;

/** The image of a point, or null behind the source. */
export function project(P: Projection, point: readonly number[]): Pixel | null {
  const [u, v, w] = P.map((row) => dot(row, point) + row[3]);
  return w > 0 ? [u / w, v / w] : null;
}

/** The point at the same depth whose image is at ``pixel``: M X + p = w (u, v, 1). */
export function moveInImage(P: Projection, point: readonly number[], pixel: Pixel): Vector {
  const depth = dot(P[2], point) + P[2][3];
  const right = [pixel[0] * depth - P[0][3], pixel[1] * depth - P[1][3], depth - P[2][3]];
  return solve(P, right);
}

/** M X = right for the left 3 x 3 part of P, by Cramer's rule. */
function solve(P: Projection, right: readonly number[]): Vector {
  const columns = [0, 1, 2].map((k) => P.map((row) => row[k]));
  const determinant = dot(columns[0], cross(columns[1], columns[2]));
  return [
    dot(right, cross(columns[1], columns[2])) / determinant,
    dot(columns[0], cross(right, columns[2])) / determinant,
    dot(columns[0], cross(columns[1], right)) / determinant,
  ];
}

/** How far a point moves (mm) for one pixel to the right and one down, at its depth. */
export function pixelDirections(P: Projection, point: readonly number[]): [Vector, Vector] {
  const at = project(P, point)!;
  return [
    add(moveInImage(P, point, [at[0] + 1, at[1]]), point, -1),
    add(moveInImage(P, point, [at[0], at[1] + 1]), point, -1),
  ];
}

/** Where a level crosses the edges between places: pieces of its contour, counted from the first place in steps.
 * values: rows of ``size``; where one of four neighbours is not known, there is no contour between them. */
export function contour(values: readonly (number | null)[], size: number, level: number): [Pixel, Pixel][] {
  const pieces: [Pixel, Pixel][] = [];
  for (let j = 0; j + 1 < values.length / size; j += 1) for (let i = 0; i + 1 < size; i += 1) {
    const corners: [number, number][] = [[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], at = corners.map(([x, y]) => values[y * size + x]);
    if (at.some((value) => value === null)) continue;
    const crossings = corners.flatMap(([x, y], k): Pixel[] => {
      const n = (k + 1) % 4, [a, b] = [at[k]!, at[n]!], f = (level - a) / (b - a);
      return a < level !== b < level ? [[x + f * (corners[n][0] - x), y + f * (corners[n][1] - y)]] : [];
    });
    for (let k = 0; k + 1 < crossings.length; k += 2) pieces.push([crossings[k], crossings[k + 1]]);
  }
  return pieces;
}

export const length = (a: readonly number[]) => Math.hypot(...a);

/** Of length 1 along a vector that has a length. */
export const unit = (v: Vector): Vector => v.map((x) => x / length(v)) as Vector;

/** One of the unit vectors across a direction. */
export const across = (along: Vector): Vector => unit(cross(along, Math.abs(along[0]) < 0.6 ? [1, 0, 0] : [0, 1, 0]));

/** 1, 2 or 5 times a power of ten, at most ``about``. */
export function roundStep(about: number): number {
  const power = 10 ** Math.floor(Math.log10(about));
  return power * Math.max(...[1, 2, 5].filter((f) => f * power <= about * (1 + 1e-9)));
}
