// Verify, optimise, sweep, report: as jobs that outlive the page, and what came of them.

import { signal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import type { components } from "../../../../openapi/typescript/tailstack";
import { onSurface, optimise, takeOptimum, verify } from "../acts";
import { key } from "../api";
import { START } from "../advice";
import { roundStep } from "../geometry";
import { adopt, cancel, forget, loadRecent, loadResult, recent, results, type Run, runs, start, startProblem, stateWords, unfinished } from "../jobs";
import { precisionOf, read } from "../readings";
import { contentOf, design, type Json, takeRun, text } from "../state";
import { brief, decimalsOf, duration, mm, percent, stated, VERDICTS } from "../words";
import { Checks, Measures } from "./Checks";
import { fetched } from "./fetched";
import { Problems } from "./Problems";
import { Reports } from "./Reports";
import { Table } from "./Words";

type Distribution = components["schemas"]["ErrorDistribution"];

const sweeping = signal(false);
const SweepForm = fetched("What sweeps a number", () => import("./Sweep").then((module) => module.SweepForm));
const Swept = fetched("What was swept", () => import("./Sweep").then((module) => module.Swept));

export function Runs() {
  const ready = Boolean(design.value), unstated = !design.value?.optimise && !design.value?.requirements?.length;
  return (
    <>
      <div class="controls" role="group" aria-label="Run">
        <button type="button" disabled={!ready} onClick={verify}>Verify by Monte Carlo, with report</button>
        <button type="button" disabled={!ready || unstated} title={unstated ? "the design states no requirement: add one under all fields" : ""} onClick={optimise}>Optimise</button>
        {design.value?.execution?.robot && <button type="button" disabled={unstated} onClick={() => start("Where the arm may go", "/v1/studies/workspace", {})}>Where the arm may go</button>}
        {onSurface.value && <span class="note">{`it puts beads on ${onSurface.value.file}`}</span>}
        {!design.value?.optimise && !unstated && !onSurface.value && <span class="note">{START}; under all fields, optimise says otherwise</span>}
      </div>
      <details onToggle={(event) => (sweeping.value = event.currentTarget.open)}>
        <summary>Sweep one number</summary>
        {sweeping.value && ready && <SweepForm />}
      </details>
      {startProblem.value && <Problems problem={startProblem.value} />}
      {runs.value.length === 0 && <p class="note">No runs yet. What is run here goes on when the page is closed, and is found again.</p>}
      <ol class="runs" aria-label="Runs of this page">{runs.value.map((run) => <Item key={run.id} run={run} />)}</ol>
      <Recent />
    </>
  );
}

/** What the service computed lately, for whoever asked: with its reports, and to be shown here. */
function Recent() {
  useEffect(() => void loadRecent(), [key.value]);
  return (
    <details>
      <summary>{`Recent jobs of the service (${recent.value.length})`}</summary>
      <Table name="Recent jobs of the service" head={<><th>Begun</th><th>What</th><th>Design</th><th>State</th><th>Report</th><th>Here</th></>}>
        {recent.value.map((job) => (
          <tr key={job.id} data-job={job.id}>
            <td>{new Date(job.created_at).toLocaleString()}</td><td>{job.kind}</td><td dir="auto">{job.design_name}</td>
            <td class={job.state === "succeeded" ? "" : `status ${job.state}`}>{stateWords(job)}</td>
            <td>{job.links.report && <Reports path={job.links.report} of={job.design_name} />}</td>
            <td>{!runs.value.some((run) => run.id === job.id) && <button type="button" class="small" aria-label={`Show ${job.kind} of ${job.design_name} here`} onClick={() => adopt(job, `${job.kind} of ${job.design_name}`, "")}>show</button>}</td>
          </tr>
        ))}
      </Table>
      <p><button type="button" class="small" onClick={loadRecent}>Look again</button></p>
    </details>
  );
}

function Item({ run }: { run: Run }) {
  const result = run.result ? results.value[run.result] : null;
  if (run.result && !result) void loadResult(run.result);
  const other = run.text !== "" && run.text !== text.value && contentOf(run.text) !== contentOf(text.value);
  return (
    <li class={other ? "run other" : "run"} data-kind={run.kind} data-state={run.state}>
      <p class="head">
        <strong>{run.title}</strong> <span class="note">{new Date(run.begun).toLocaleTimeString()}{other ? ", of another state of the design" : ""}</span>
        <span class={run.state === "succeeded" ? "note" : `status ${run.state}`}>{stateWords(run)}</span>
        {unfinished(run)
          ? <button type="button" class="small" onClick={() => cancel(run.id)}>Cancel</button>
          : <button type="button" class="small" onClick={() => forget(run.id)}>Take off the list</button>}
        {other && <button type="button" class="small" onClick={() => takeRun(run.text, `Back to the design of ${run.title}`)}>Back to that design</button>}
      </p>
      {unfinished(run) && (
        <>
          <progress max={1} value={run.fraction} aria-label={`${run.title}: progress`} />
          <p class="note">{`${percent(run.fraction, 0)}${run.eta !== null ? `, about ${duration(run.eta)} left` : ""}${run.note ? `: ${run.note}` : ""}`}</p>
        </>
      )}
      {run.problem && <Problems problem={run.problem} />}
      {result && <div class={other && run.kind !== "sweep" ? "old" : ""}><Outcome run={run} result={result} /></div>}
      {run.report && <p class="note">Report: <Reports path={run.report} of={result?.provenance?.design_name ?? result?.title} /></p>}
    </li>
  );
}

function Outcome({ run, result }: { run: Run; result: Json }) {
  if (run.kind === "verification") return <Verified result={result} />;
  if (run.kind === "optimisation") return <Optimum result={result} />;
  if (run.kind === "comparison") return <>{[result.headline.sentence, ...result.headline.matters].map((sentence: string) => <p key={sentence}>{sentence}</p>)}</>;
  if (run.kind === "sweep") return <Swept run={run} result={result} />;
  if (result.conclusions) return <>{result.conclusions.map((sentence: string) => <p key={sentence}>{sentence}</p>)}{result.fields && <Workspace study={result} />}</>;
  if (run.kind !== "report") return null;
  return (
    <>
      {result.verification && <Verified result={result.verification} />}
      {result.distributions.map((shares: Distribution) => (
        <Histogram key={shares.target} shares={shares} decimals={decimalsOf(result.verification ?? result.score)} p95={(result.verification ?? result.score).targets.find((t: Json) => t.name === shares.target).p95_mm}
          limit={result.score.targets.find((t: Json) => t.name === shares.target).limit_mm} perUnit={result.score.verdict.checks.some((c: Json) => c.target === shares.target && c.risk === "per_unit")} />
      ))}
      {!result.verification && <p class="note">The slack of each half-width stands in the budget.</p>}
    </>
  );
}

/** How often which error occurs: sampled as bars, by first order as a line; where P95 and the limit are. */
function Histogram({ shares, decimals: d, p95, limit, perUnit }: { shares: Distribution; decimals: number; p95: number; limit: number | null; perUnit: boolean }) {
  const { edges_mm: edges, sampled, first_order: law } = shares, width = 360, height = 110, foot = 18;
  const end = edges[edges.length - 1], step = roundStep(end / 4), top = Math.max(...law, ...(sampled ?? []), 1e-9);
  const x = (value: number) => (width * value) / end, y = (share: number) => height - (0.92 * height * share) / top;
  const line = law.map((share, k) => `${k ? "L" : "M"}${x(edges[k])} ${y(share)}H${x(edges[k + 1])}`).join("");
  const marks = [{ name: "P95", at: p95 }, ...(limit === null ? [] : [{ name: "limit", at: limit }])];
  const words = `Error at the tool, target ${shares.target}: ${sampled ? `bars: share of ${shares.trials!.toLocaleString("en")} sampled shots; line: ` : ""}first order; ${sampled ? "simulated P95" : "P95 by estimate"} ${mm(p95, d)} mm${limit === null ? "" : `, limit ${stated(limit, d)} mm`}${perUnit ? "; all units together: what is asked of each unit stands in the table" : ""}`;
  return (
    <figure class="histogram">
      <figcaption>{words}</figcaption>
      <svg viewBox={`0 -12 ${width} ${height + foot + 12}`} role="img" aria-label={words}>
        {sampled?.map((share, k) => <rect key={k} x={x(edges[k]) + 0.5} width={x(edges[k + 1]) - x(edges[k]) - 1} y={y(share)} height={height - y(share)} />)}
        <path class="law" d={line} />
        {marks.filter(({ at }) => at <= end).map(({ name, at }) => (
          <g key={name} class={name}><path d={`M${x(at)} ${height}V0`} /><text x={x(at)} y="-2" text-anchor={(name === "P95") === (limit !== null && p95 < limit) ? "end" : "start"}>{name}</text></g>
        ))}
        <path class="axis" d={`M0 ${height}H${width}`} />
        {Array.from({ length: Math.ceil(end / step) }, (_, k) => <text key={k} x={x(k * step)} y={height + 13} text-anchor={k ? "middle" : "start"}>{`${brief(k * step)}${(k + 1) * step < end ? "" : " mm"}`}</text>)}
      </svg>
    </figure>
  );
}

/** Where the arm may go: the fewer poses of a field keep the limit, the fainter it is. */
function Workspace({ study }: { study: Json }) {
  return (
    <div class="controls" data-kind="estimate">
      {["from above", "from the side"].map((plane) => {
        const fields: Json[] = study.fields.filter((each: Json) => each.plane === plane), side = study.field_mm, xs = fields.map((each) => each.x_mm), ys = fields.map((each) => -each.beside_mm);
        const left = Math.min(...xs) - side / 2, top = Math.min(...ys) - side / 2, words = `${plane}, stronger where more of the poses keep the limit: ${mm(Math.max(...xs) + side / 2 - left, 0)} mm of the robot's x across`;
        return (
          <figure key={plane} class="histogram">
            <figcaption>{words}</figcaption>
            <svg viewBox={`${left} ${top} ${Math.max(...xs) + side / 2 - left} ${Math.max(...ys) + side / 2 - top}`} role="img" aria-label={words}>
              {fields.map((each, k) => <rect key={k} x={xs[k] - side / 2} y={ys[k] - side / 2} width={side} height={side} style={{ opacity: 0.05 + (0.95 * each.within) / each.poses }}><title>{`${each.within} of ${each.poses} poses keep the limit`}</title></rect>)}
            </svg>
          </figure>
        );
      })}
    </div>
  );
}

function Verified({ result }: { result: Json }) {
  const reading = read<"simulation">(result), d = reading.decimals;
  return (
    <>
      <p><strong class={`status ${result.verdict.status}`}>{VERDICTS[result.verdict.status] ?? result.verdict.status}</strong>{`: ${result.trials.toLocaleString("en")} simulated shots, each with its own installation and noise. `}<span class="note" title={result.stopping}>{`${reading.headline} is known to ±${percent(precisionOf(reading), 2)}; the estimate of P95 is ${percent(Math.abs(result.first_order_ratio - 1))} ${result.first_order_ratio < 1 ? "below" : "above"} the simulation.`}</span></p>
      <Checks of={reading} label="Requirements as verified" />
      <Measures of={reading} />
      <Table name="Verification" kind="simulation" head={<><th>Target</th><th class="number">P95 simulated, mm</th><th class="number">{`${percent(result.targets[0]?.confidence, 0)} interval, mm`}</th><th class="number">Mean, mm</th><th class="number">Worst seen, mm</th><th class="number">Over the limit</th><th class="number">P95 by estimate, mm</th></>}>
        {result.targets.slice(0, 200).map((t: Json) => (
          <tr key={t.name}><th>{t.name}</th><td class="number">{mm(t.p95_mm, d)}</td><td class="number">{t.p95_interval_mm.map((v: number) => mm(v, d)).join(" to ")}</td>
            <td class="number">{mm(t.mean_norm_mm, d)}</td><td class="number">{mm(t.worst_mm, d)}</td><td class="number">{percent(t.exceedance?.probability ?? null, 2)}</td><td class="number" data-kind="estimate">{mm(t.first_order_p95_mm, d)}</td></tr>
        ))}
      </Table>
    </>
  );
}

function Optimum({ result }: { result: Json }) {
  const check = read<"simulation">(result.certificate.verification), d = check.decimals, width = (half: number, { unit }: Json) => `${brief(half)} ${unit.replace("deg", "°")}`;
  return (
    <>
      <p><span data-kind="estimate">{`By estimate: P95 ${mm(result.p95_before_mm, d)} → ${mm(result.p95_after_mm, d)} mm; cost ${brief(result.cost_before)} → ${brief(result.cost_after)}.`}</span>{" "}<span data-kind="simulation">{`By simulation, after: ${check.headline} ${mm(check.value, check.digits)} ${check.unit}, ${VERDICTS[check.record.verdict.status] ?? check.record.verdict.status}.`}</span></p>
      {[result.certificate.cheapest?.statement, result.certificate.global_bound?.statement, result.view_offer?.sentence, result.aimed?.sentence, result.moves?.sentence, ...result.influence.map(({ message }: Json) => message)].filter(Boolean).map((sentence: string) => <p key={sentence} class="note">{sentence}</p>)}
      <Table name="What changes" head={<><th>What changes</th><th class="number">before</th><th class="number">after</th></>}>
        {result.moved.slice(0, 100).map((m: Json) => <tr key={m.label}><th>{m.label}</th><td class="number">{point(m.before_mm)}</td><td class="number">{point(m.after_mm)}</td></tr>)}
        {result.tolerances.slice(0, 100).map((t: Json) => <tr key={t.contributor + t.component}><th>{(t.label || t.contributor).endsWith(` ${t.component}`) ? t.label || t.contributor : `${t.label || t.contributor} ${t.component}`}</th><td class="number">{t.before_drawn ?? width(t.before_half_width, t)}</td><td class="number">{t.before_drawn ? t.grade : width(t.after_half_width, t) + (t.grade ? `, ${t.grade}` : "")}</td></tr>)}
      </Table>
      {result.design && <p><button type="button" onClick={() => takeOptimum(result)}>Take this design (undo brings yours back)</button></p>}
    </>
  );
}

const point = (p: number[] | null) => (p ? `${p.map((v) => v.toFixed(2)).join(", ").replace(/-/g, "−")} mm` : "–");
