// Requirements as one record judged them, all of one kind.

import type { AnyReading, Check } from "../readings";
import { mm, percent, stated, VERDICTS } from "../words";
import { Term } from "./Words";

export const interval = (ends: readonly (number | null)[], d: number) => (ends[1] === null ? `${mm(ends[0], d)}, no upper end known` : `${mm(ends[0], d)} to ${mm(ends[1], d)}`);

/** Every requirement at every target, as they were judged. */
export function Checks({ of: { kind, record, decimals: d }, label }: { of: AnyReading; label: string }) {
  const checks: readonly Check[] = record.verdict.checks;
  if (!checks.length) return null;
  const units = checks.some((check) => check.yield_fraction !== null);
  const unit = new Set(checks.map((check) => check.unit)).size === 1 ? `, ${checks[0].unit}` : "";
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={label}>
      <table class="checks" data-kind={kind}>
        <thead><tr><th><Term word="requirement">Requirement</Term></th><th>Status</th><th class="number">{`${kind === "simulation" ? "Simulated" : "Estimate"}${unit}`}</th><th class="number">{`Between${unit}`}</th><th class="number">{`Limit${unit}`}</th>{units && <th class="number">Units within it (asked for)</th>}</tr></thead>
        <tbody>
          {checks.slice(0, 400).map((check) => (
            <tr key={check.requirement + check.target}>
              <th>{`${check.requirement} at ${check.target}`}<span class="note">{`${check.headline}${check.error === "tcp" ? "" : " as located"}; ${check.risk === "pooled" ? "pooled: all units and shots together" : "per unit: each by itself"}`}</span></th>
              <td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
              <td class="number">{mm(check.value, d)}</td><td class="number">{interval(check.interval, d)}</td><td class="number">{stated(check.limit, d)}{!unit && ` ${check.unit}`}</td>
              {units && <td class="number">{check.yield_fraction === null ? "–" : `${percent(check.yield_fraction)} (${percent(check.min_yield)})`}</td>}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
