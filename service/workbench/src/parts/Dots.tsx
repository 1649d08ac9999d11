// Fifty shots that stand for all, as a quantile dot plot: of what decides, by estimate.

import { type FiftyShots, heap, missWords, scaleOf, TALLEST, WIDE } from "../dots";

interface Row {
  name: string; // empty for one that stands alone
  shots: FiftyShots;
}
export const isDrawn = (row: { name: string; shots?: FiftyShots | null }): row is Row => Boolean(row.shots);

/** Rows of dots below one another; those of one unit on one scale. */
export function Dots({ rows, old = false }: { rows: Row[]; old?: boolean }) {
  return (
    <div class={old ? "dots old" : "dots"} data-kind="estimate" data-testid="dots">
      {rows.map(({ name, shots }) => {
        const { end, step } = scaleOf(rows.map((row) => row.shots).filter(({ unit }) => unit === shots.unit)), size = (WIDE * step) / end;
        const told = `${name && `${name}: `}${missWords(shots)}, by estimate`, x = (value: number) => (WIDE * value) / end;
        return (
          <figure key={name} title={`Each dot stands for 2 % of all shots: ${shots.of}. Beyond the limit it is a cross.`}>
            <svg viewBox={`-2 0 ${WIDE + 4} ${TALLEST + 4}`} role="img" aria-label={told}>
              <path class="ground" d={`M0 ${TALLEST + 2}h${WIDE}`} />
              {[...heap(shots, end, step)].flatMap(([column, count]) => Array.from({ length: count }, (_, level) => {
                const at = x(shots.limit + (column + 0.5) * step), up = TALLEST + 2 - (level + 0.5) * size, r = 0.44 * size;
                return column >= 0
                  ? <path key={`${column} ${level}`} class="miss" d={`M${at - r} ${up - r}l${2 * r} ${2 * r}m${-2 * r} 0l${2 * r} ${-2 * r}`} stroke-width={0.6 * r} />
                  : <circle key={`${column} ${level}`} cx={at} cy={up} r={r} />;
              }))}
              <path class="limit" d={`M${x(shots.limit)} 0V${TALLEST + 2}`} />
            </svg>
            <figcaption>{told}</figcaption>
          </figure>
        );
      })}
    </div>
  );
}
