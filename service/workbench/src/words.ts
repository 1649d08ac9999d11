// Numbers and sentences for people.

/** Millimetres to the micrometre; the service's number, rounded only for the eye. */
export const mm = (value: number | null | undefined, digits = 3): string =>
  value === null || value === undefined ? "–" : value.toFixed(digits).replace("-", "−");

/** A change, with an arrow for its sign: "▼ 0.046". */
export const changed = (by: number, digits = 3): string => `${by < 0 ? "▼" : "▲"} ${Math.abs(by).toFixed(digits)}`;

export const percent = (share: number | null | undefined, digits = 1): string =>
  share === null || share === undefined ? "–" : `${(100 * share).toFixed(digits)} %`.replace("-", "−");

/** Four significant digits, without a tail of zeros. */
export const brief = (value: number | null | undefined): string =>
  value === null || value === undefined ? "–" : String(Number(value.toPrecision(4))).replace("-", "−");

/** What is typed as a number: a comma or a point, a minus of either kind, and the unit of the field; null for anything else. */
export function readNumber(typed: string, unit = ""): number | null {
  let words = typed.trim().replace("−", "-").replace(",", ".");
  if (unit && words.endsWith(unit)) words = words.slice(0, -unit.length).trimEnd();
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$/i.test(words) ? Number(words) : null;
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
