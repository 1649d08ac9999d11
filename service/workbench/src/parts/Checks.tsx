// Requirements as one record judged them, all of one kind, and the measures that it tells besides those of each target.

import type { AnyReading, Check } from "../readings";
import { decimalsOf, levelOf, mm, percent, sign, stated, told, VERDICTS } from "../words";
import { Table, Term } from "./Words";

export const interval = (ends: readonly (number | null)[], d: number) => (ends[1] === null ? `${mm(ends[0], d)}, no upper end known` : `${mm(ends[0], d)} to ${mm(ends[1], d)}`);

/** As it is stated, with its unit. */
export const limitWords = (limit: number, d: number, unit: string) => (unit === "of 1" ? `${Number((100 * limit).toPrecision(12))} %` : `${stated(limit, d)}${sign(unit)}`);

/** Every requirement at every target, as they were judged. */
export function Checks({ of: { kind, record }, label }: { of: AnyReading; label: string }) {
  const checks: readonly Check[] = record.verdict.checks;
  if (!checks.length) return null;
  const levels = checks.some((check) => check.yield_fraction !== null);
  const unit = new Set(checks.map((check) => check.unit)).size === 1 ? `, ${checks[0].unit}` : "";
  return (
    <Table name={label} look="checks" kind={kind} head={<><th><Term word="requirement">Requirement</Term></th><th>Status</th><th class="number">{`${kind === "simulation" ? "Simulated" : "Estimate"}${unit}`}</th><th class="number">{`Between${unit}`}</th><th class="number">{`Limit${unit}`}</th>{levels && <th class="number">Within it (asked for)</th>}</>}>
      {checks.slice(0, 400).map((check) => ({ check, d: decimalsOf(record, check.unit) })).map(({ check, d }) => (
        <tr key={check.requirement + check.target}>
          <th>{`${check.requirement} at ${check.target}`}<span class="note">{`${check.headline} of ${check.words}; ${levelOf(check.risk) ? `per ${levelOf(check.risk)}: each by itself` : "pooled: all shots together"}${check.ids?.length ? "; " : ""}`}{check.ids?.map((id, k) => [k ? ", " : "", <span key={id} class="id">{id}</span>])}</span></th>
          <td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
          <td class="number">{unit ? mm(check.value, d) : told(check.value, d, check.unit)}</td><td class="number">{interval(check.interval, d)}</td><td class="number">{unit ? stated(check.limit, d) : limitWords(check.limit, d, check.unit)}</td>
          {levels && <td class="number">{check.yield_fraction === null ? "–" : `${percent(check.yield_fraction)} of ${levelOf(check.risk)}s (${percent(check.min_yield)})`}</td>}
        </tr>
      ))}
    </Table>
  );
}

/** Measures that join several targets, each in its unit; nothing where there are none. */
export function Measures({ of: { kind, record } }: { of: AnyReading }) {
  if (!record.measures?.length) return null;
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Measures of several targets">
      <table data-kind={kind}>
        <thead><tr><th>Measure</th><th class="number">{kind === "simulation" ? "P95 simulated" : "P95"}</th><th class="number">Mean</th><th class="number">Known part</th><th class="number">Limit</th><th class="number">Over the limit</th></tr></thead>
        <tbody>
          {record.measures.slice(0, 200).map((each) => ({ each, d: decimalsOf(record, each.unit) })).map(({ each, d }) => (
            <tr key={each.measure + each.site}>
              <th>{`${each.words}, ${each.site}`}</th><td class="number">{told(each.p95, d, each.unit)}</td><td class="number">{mm(each.mean, d)}</td><td class="number">{mm(each.known, d)}</td>
              <td class="number">{each.limit === null ? "–" : stated(each.limit, d)}</td><td class="number">{percent(each.exceedance_probability, 2)}</td>
            </tr>
          ))}
        </tbody>
      </table>
      {record.measures.filter((each) => each.breaches?.length).map((each) => (
        <p key={each.site} class="note">{`${each.site}: out of its corridor in ${each.breaches!.map(({ beyond_mm, probability }) => `${percent(probability, 2)} of shots${beyond_mm ? ` by more than ${beyond_mm} mm` : ""}`).join(", ")}.`}</p>
      ))}
    </div>
  );
}
