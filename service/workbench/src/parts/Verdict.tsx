// What the numbers say, in a strip that is always in sight.

import { useEffect, useRef } from "preact/hooks";
import { answer, busy, current, refused, type Score, trouble } from "../api";
import { mm, percent, trust, VERDICTS } from "../words";
import { Problems } from "./Problems";

export function Verdict() {
  const score = answer.value?.score, problem = refused.value, old = !current.value;
  const worst = score && [...score.verdict.checks].sort((a, b) => margin(a) - margin(b))[0];
  const target = score && (score.targets.find((t) => t.name === worst?.target) ?? score.targets[0]);
  const status = problem ? "refused" : score?.verdict.status ?? "no requirement";
  return (
    <section class={`verdict ${status.replace(" ", "-")}`} aria-label="Verdict" data-current={String(!old && !problem)}>
      <p class="badge">{problem ? "No answer" : old ? "…" : VERDICTS[status] ?? status}</p>
      {target && (
        <dl class={old ? "numbers old" : "numbers"} data-testid="numbers">
          <div>
            <dt>{worst ? `${worst.headline} of the error ${worst.error === "tcp" ? "at the tool" : "as located"}, target ${worst.target}` : `P95 of the error at the tool, target ${target.name}`}</dt>
            <dd><output id="p95" aria-live="off">{mm(worst?.value_mm ?? target.p95_mm)}</output> mm</dd>
          </div>
          {worst && <div><dt>Between</dt><dd>{interval(worst.interval_mm)}</dd></div>}
          {worst && <div><dt>Limit</dt><dd>{mm(worst.limit_mm)} mm</dd></div>}
          {worst?.yield_fraction != null && <div><dt>Units that meet it</dt><dd>{percent(worst.yield_fraction)}{worst.min_yield != null && ` (asked for: ${percent(worst.min_yield)})`}</dd></div>}
          <div><dt>Known bias</dt><dd>{mm(Math.hypot(...target.bias_mm))} mm</dd></div>
          <div><dt>Mean error</dt><dd>{mm(target.mean_norm_mm)} mm</dd></div>
        </dl>
      )}
      <div class="sentence">
        {trouble.value ? <Problems problem={trouble.value} undoable={problem !== null && problem.status !== 0} /> : score && <Findings score={score} />}
      </div>
      <p class="hidden" role="status">{busy.value ? "" : problem ? problem.title : target ? `P95 ${mm(worst?.value_mm ?? target.p95_mm)} mm, ${VERDICTS[status] ?? status}` : ""}</p>
    </section>
  );
}

type Check = Score["verdict"]["checks"][number];
const margin = (check: Check) => check.margin_mm ?? check.limit_mm - check.value_mm; // null: its upper end is not known
const interval = (ends: readonly (number | null)[]) => (ends[1] === null ? `${mm(ends[0])} and more` : `${mm(ends[0])} to ${mm(ends[1])}`);

function Findings({ score }: { score: Score }) {
  const [first, second, ...more] = score.verdict.findings.map(({ message }) => <p key={message}>{message}</p>);
  return (
    <>
      {first}{second}
      {more.length > 0 && <details><summary>{`${more.length} more remarks`}</summary>{more}</details>}
      <p class="note" title={score.validity.statement}>{trust(score.validity)}</p>
    </>
  );
}

/** What becomes of each requirement when one fiducial or two are not found; not looked for while something is moved. */
function Losses({ score }: { score: Score }) {
  const last = useRef<Score["losses"]>([]), shown = score.losses.length ? score.losses : last.current;
  useEffect(() => void (last.current = shown), [shown]);
  if (!shown.length) return null;
  const words = (loss: Score["losses"][number]["single"] | null) =>
    loss === null ? "too many pairs to try" : `${loss.lost.join(" and ")}: ${loss.value_mm === null ? loss.reason : `${mm(loss.value_mm)} mm`}`;
  const mixed = shown.some(({ mixture }) => mixture); // the design says how often fiducials are missed
  const verdict = (loss: { value_mm: number | null } | null, limit: number | null) =>
    loss === null || limit === null ? "" : loss.value_mm !== null && loss.value_mm <= limit ? "status pass" : "status fail";
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Lost fiducials">
      <table class={current.value && score.losses.length ? "" : "old"}>
        <caption>If fiducials are not found: the worst of all losses</caption>
        <thead><tr><th>Requirement</th><th class="number">With all, mm</th><th>Without one</th><th>Without two</th>{mixed && <th>Missed as often as stated</th>}</tr></thead>
        <tbody>
          {shown.map((loss) => (
            <tr key={loss.requirement}>
              <th>{loss.requirement || "P95 at the tool"}</th><td class="number">{mm(loss.value_mm)}</td>
              <td class={verdict(loss.single, loss.limit_mm)}>{words(loss.single)}</td><td class={verdict(loss.double, loss.limit_mm)}>{words(loss.double)}</td>
              {loss.mixture && (
                <td class={verdict(loss.mixture, loss.limit_mm)}>
                  {loss.mixture.value_mm === null ? "no bound: too many shots have no answer" : `${percent(loss.mixture.quantile)} of all shots: ${mm(loss.mixture.value_mm)} mm`}
                </td>
              )}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

/** Every requirement at every target, both readings of the risk, and what lost fiducials do. */
export function Requirements() {
  const score = answer.value?.score, checks = score?.verdict.checks ?? [], shade = current.value ? "" : "old";
  return (
    <>
      {checks.length === 0 ? <p class="note">The design states no requirement; add one below, under all fields.</p> : (
        <div class="scroll" tabIndex={0} role="region" aria-label="Requirements">
          <table class={shade}>
            <thead><tr><th>Requirement</th><th>Target</th><th>Judged</th><th class="number">Found, mm</th><th class="number">Between, mm</th><th class="number">Limit, mm</th><th class="number">Units within it</th><th>Status</th></tr></thead>
            <tbody>
              {checks.slice(0, 400).map((check) => (
                <tr key={check.requirement + check.target}>
                  <th>{check.requirement}</th><td>{check.target}</td>
                  <td>{check.risk === "pooled" ? "pooled: all units and shots together" : "per unit: each unit by itself"}</td>
                  <td class="number">{mm(check.value_mm)}</td><td class="number">{interval(check.interval_mm)}</td><td class="number">{mm(check.limit_mm)}</td>
                  <td class="number">{check.yield_fraction === null ? "–" : `${percent(check.yield_fraction)} of ${percent(check.min_yield)} asked for`}</td>
                  <td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
                </tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
      {score && (
        <div class="scroll" tabIndex={0} role="region" aria-label="Pooled and per unit">
          <table class={shade}>
            <caption>Two readings of the risk at the tool</caption>
            <thead><tr><th>Target</th><th class="number">Pooled: 95 % of all shots within, mm</th><th class="number">Per unit: P95 that 95 % of units keep, mm</th><th class="number">Units whose own quantile keeps the limit</th></tr></thead>
            <tbody>
              {score.targets.slice(0, 50).map((target) => (
                <tr key={target.name}><th>{target.name}</th><td class="number">{mm(target.p95_mm)}</td><td class="number">{mm(target.per_unit.p95_of_units_mm)}</td><td class="number">{percent(target.per_unit.yield_fraction)}</td></tr>
              ))}
            </tbody>
          </table>
        </div>
      )}
      {score && <Losses score={score} />}
    </>
  );
}
