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
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label={label}>
      <table class="checks" data-kind={kind}>
        <thead><tr><th><Term word="requirement">Requirement</Term></th><th>Status</th><th class="number">{kind === "simulation" ? "Simulated, mm" : "Estimate, mm"}</th><th class="number">Between, mm</th><th class="number">Limit, mm</th>{units && <th class="number">Units within it (asked for)</th>}</tr></thead>
        <tbody>
          {checks.slice(0, 400).map((check) => (
            <tr key={check.requirement + check.target}>
              <th>{`${check.requirement} at ${check.target}`}<span class="note">{`${check.headline}${check.error === "tcp" ? "" : " as located"}; ${check.risk === "pooled" ? "pooled: all units and shots together" : "per unit: each by itself"}`}</span></th>
              <td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
              <td class="number">{mm(check.value_mm, d)}</td><td class="number">{interval(check.interval_mm, d)}</td><td class="number">{stated(check.limit_mm, d)}</td>
              {units && <td class="number">{check.yield_fraction === null ? "–" : `${percent(check.yield_fraction)} (${percent(check.min_yield)})`}</td>}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
