// Numbers and sentences for people.

/** A length, or another number of a measure, with the decimals of its answer. */
export const mm = (value: number | null | undefined, decimals: number): string =>
  value === null || value === undefined ? "–" : value.toFixed(decimals).replace("-", "−");

/** With its unit: 1.68 mm, 1.78°, and a part of one as 0.5 %. */
export const told = (value: number | null | undefined, decimals: number, unit: string): string =>
  value == null ? "–" : unit === "of 1" ? percent(value, Math.max(0, decimals - 2)) : `${mm(value, decimals)}${sign(unit)}`;
/** What a requirement reads by itself, as its ``risk`` names it: of per_unit each unit; nothing where it is pooled. */
export const levelOf = (risk: string): string => (risk.startsWith("per_") ? risk.slice(4) : "");
/** A unit after its number. */
export const sign = (unit: string): string => (unit === "deg" ? "°" : ` ${unit}`);

/** What a design states is never rounded: with as many decimals, or with all that it has. */
export const stated = (value: number, decimals: number): string => (Number(value.toFixed(decimals)) === value ? value.toFixed(decimals) : String(value));

// The rule of every output (solver/tailstack/results/digits.py): the last decimal is of the decade of the error, at the limit
const ESTIMATE = 0.01, FINEST = 6, ROUNDING = 1.02;

/** Decimals of a length of this size, mm, that is known to a relative error. */
export function countDecimals(size: number, error = ESTIMATE): number {
  const worth = ROUNDING * Math.abs(size) * Math.min(error, ESTIMATE);
  return worth > 0 && Number.isFinite(worth) ? Math.min(Math.max(-Math.floor(Math.log10(worth)), 0), FINEST) : 3;
}

interface Judged {
  verdict: { checks: readonly { value: number; interval: readonly (number | null)[]; limit: number; unit: string }[] };
  targets: readonly { p95_mm: number }[];
  precision_reached?: number; // of a simulation
}
/** Decimals of every number of an answer in a unit, lengths if none is said: those that its finest requirement asks for. */
export function decimalsOf({ verdict, targets, precision_reached: error }: Judged, unit = "mm"): number {
  const checks = verdict.checks.filter((check) => check.unit === unit);
  const wide = ({ value, interval: [low, high] }: Judged["verdict"]["checks"][number]) => (high === null || value <= 0 ? 0 : (high - low!) / 2 / value) || ESTIMATE;
  return checks.length ? Math.max(...checks.map((check) => countDecimals(check.limit, wide(check)))) : countDecimals(Math.max(...targets.map(({ p95_mm: p95 }) => p95)), error);
}

/** A change, with an arrow for its sign: "▼ 0.046". */
export const changed = (by: number, digits: number): string => `${by < 0 ? "▼" : "▲"} ${Math.abs(by).toFixed(digits)}`;

export const percent = (share: number | null | undefined, digits = 1): string =>
  share === null || share === undefined ? "–" : `${(100 * share).toFixed(digits)} %`.replace("-", "−");

/** Four significant digits, without a tail of zeros. */
export const brief = (value: number | null | undefined): string =>
  value === null || value === undefined ? "–" : String(Number(value.toPrecision(4))).replace("-", "−");

const EITHER = /^[-+−]?[1-9]\d{0,2},\d{3}$/; // thousands to some, thousandths to others

/** What is typed without the unit of its field. */
const bare = (typed: string, unit: string) => (unit && typed.trim().endsWith(unit) ? typed.trim().slice(0, -unit.length) : typed).trim();

/** What is typed as a number: a comma or a point, a minus of either kind, and the unit of the field; null for anything else,
 * what may be a thousand times another too. */
export function readNumber(typed: string, unit = ""): number | null {
  const words = bare(typed, unit), number = Number(words.replace("−", "-").replace(",", "."));
  return /^[-+−]?(\d+[.,]?\d*|[.,]\d+)(e[-+−]?\d+)?$/i.test(words) && !EITHER.test(words) && Number.isFinite(number) ? number : null;
}

/** Why what is typed is no number. */
export function whyNoNumber(typed: string, unit = ""): string {
  const words = bare(typed, unit);
  return EITHER.test(words) ? `“${words}” may be ${words.replace(",", "")} or ${words.replace(",", ".")}: write one of them` : `“${typed.trim()}” is not a number${unit ? ` in ${unit}` : ""}`;
}

export const duration = (seconds: number): string =>
  seconds < 1.5 ? "1 s" : seconds < 90 ? `${Math.round(seconds)} s` : `${Math.floor(seconds / 60)} min ${Math.round(seconds % 60)} s`;

export const VERDICTS: Record<string, string> = {
  pass: "Pass", fail: "Fail", inconclusive: "Not decided", "not-evaluated": "Not evaluated", "no requirement": "No limit stated",
};

/** How far the estimate can be trusted, and what to do where it cannot; the method's own sentence is its title. */
export function trust({ expected_error_percent: error, calibrated }: { expected_error_percent: number | null; calibrated: boolean }): string {
  if (error !== null) return `The estimate is within ${error} % of what a simulation gives${error > 1 ? "; where it errs it is mostly too small: verify" : ""}.`;
  return calibrated
    ? "The estimate does not hold for this layout and may be far too small: verify."
    : "How good the estimate is for such a design is not known: only a simulation decides, verify.";
}
