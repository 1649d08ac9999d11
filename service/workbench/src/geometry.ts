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

export const length = (a: readonly number[]) => Math.hypot(...a);

/** 1, 2 or 5 times a power of ten, at most ``about``. */
export function roundStep(about: number): number {
  const power = 10 ** Math.floor(Math.log10(about));
  return power * Math.max(...[1, 2, 5].filter((f) => f * power <= about * (1 + 1e-9)));
}
