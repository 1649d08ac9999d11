// What the numbers say, in a strip that is always in sight.

import { answer, busy, current, pathOf, placeInWords, reachable, refused } from "../api";
import { design, undo, canUndo, valueAt } from "../state";
import { mm, percent, VERDICTS } from "../words";

export function Verdict() {
  const score = answer.value?.score, problem = refused.value, old = !current.value;
  const worst = score && [...score.verdict.checks].sort((a, b) => (a.margin_mm ?? Infinity) - (b.margin_mm ?? Infinity))[0];
  const target = score && (score.targets.find((t) => t.name === worst?.target) ?? score.targets[0]);
  const status = problem ? "refused" : score?.verdict.status ?? "none";
  return (
    <section class={`verdict ${problem ? "refused" : status}`} aria-label="Verdict" data-current={String(!old && !problem)}>
      <p class="badge">{problem ? "No answer" : old ? "…" : VERDICTS[status] ?? status}</p>
      {target && (
        <dl class={old ? "numbers old" : "numbers"} data-testid="numbers">
          <div>
            <dt>{worst ? `${worst.headline} of the ${worst.error} error, target ${worst.target}` : `P95 of the TCP error, target ${target.name}`}</dt>
            <dd><output id="p95" aria-live="off">{mm(worst?.value_mm ?? target.p95_mm)}</output> mm</dd>
          </div>
          {worst && <div><dt>Limit</dt><dd>{mm(worst.limit_mm)} mm</dd></div>}
          {worst?.yield_fraction != null && <div><dt>Units that meet it</dt><dd>{percent(worst.yield_fraction)}{worst.min_yield != null && ` of ${percent(worst.min_yield)}`}</dd></div>}
          <div><dt>Known bias</dt><dd>{mm(Math.hypot(...target.bias_mm))} mm</dd></div>
          <div><dt>Mean error</dt><dd>{mm(target.mean_norm_mm)} mm</dd></div>
        </dl>
      )}
      <div class="sentence">
        {problem ? <Problems /> : (
          <>
            {score?.verdict.findings.slice(0, 3).map((finding) => <p key={finding.message}>{finding.message}</p>)}
            {score && <p class="note">{score.validity.statement}</p>}
          </>
        )}
        {!reachable.value && <p class="bad">The service does not answer. The design is kept in this browser.</p>}
      </div>
      <p class="hidden" role="status">{busy.value ? "" : problem ? problem.title : target ? `P95 ${mm(worst?.value_mm ?? target.p95_mm)} mm, ${VERDICTS[status] ?? status}` : ""}</p>
    </section>
  );
}

function Problems() {
  const problem = refused.value!;
  return (
    <div class="problems">
      <p><strong>{problem.title}</strong></p>
      <ul>
        {problem.errors.slice(0, 6).map((error) => (
          <li key={error.pointer + error.detail}>
            {error.pointer && <code title={error.pointer}>{placeInWords(design.value, error.pointer)}</code>} {error.detail}
            {error.hint && <span class="note"> {error.hint}</span>}
            {error.pointer && valueAt(design.value, pathOf(error.pointer)) !== undefined && (
              <button type="button" class="small" onClick={() => document.dispatchEvent(new CustomEvent("show-pointer", { detail: error.pointer }))}>show</button>
            )}
          </li>
        ))}
      </ul>
      {problem.errors.length > 6 && <p>{`and ${problem.errors.length - 6} more`}</p>}
      {canUndo.value && <p><button type="button" onClick={undo}>Undo the last change</button></p>}
    </div>
  );
}

/** Every requirement at every target. */
export function Requirements() {
  const checks = answer.value?.score.verdict.checks ?? [];
  if (!checks.length) return <p class="note">The design states no requirement; add one below, under all fields.</p>;
  return (
    <div class="scroll" tabIndex={0} role="region" aria-label="Requirements">
      <table class={current.value ? "" : "old"}>
        <thead><tr><th>Requirement</th><th>Target</th><th>Judged</th><th class="number">Found, mm</th><th class="number">Limit, mm</th><th class="number">Units within it</th><th>Status</th></tr></thead>
        <tbody>
          {checks.slice(0, 400).map((check) => (
            <tr key={check.requirement + check.target}>
              <th>{check.requirement}</th><td>{check.target}</td>
              <td>{check.risk === "pooled" ? "over all units and shots together (pooled)" : "unit by unit"}</td>
              <td class="number">{mm(check.value_mm)}</td><td class="number">{mm(check.limit_mm)}</td>
              <td class="number">{percent(check.yield_fraction)}</td><td class={`status ${check.status}`}>{VERDICTS[check.status] ?? check.status}</td>
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}
