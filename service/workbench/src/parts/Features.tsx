// The features of seats as their drawings state them: every value to type.

import { SEATS } from "../document";
import { design, type Json, type Path } from "../state";
import { NumberField, UNIT } from "./Controls";
import { Leaf } from "./Form";

const PLACE = ["x", "y", "z"], SIZE = ["along", "across"], LIMITS = ["upper", "lower"];

export function Features() {
  const listed = (seat: string): Json[] => [design.value?.interfaces?.[seat]?.features ?? []].flat();
  return (
    <div class="geometry">
      {SEATS.flatMap((seat) => listed(seat).map((feature, k) => (
        <fieldset key={`${seat} ${k}`}>
          <legend>{`${seat.replace(/_/g, " to ")}: ${feature?.name ?? k + 1}, ${String(feature?.kind).replace(/_/g, " ")}`}</legend>
          {Object.entries(feature ?? {}).filter(([name]) => !/^(name|kind)$/.test(name)).map(([name, value]) => <Value key={name} name={name} value={value} path={["interfaces", seat, "features", k, name]} />)}
        </fieldset>
      )))}
    </div>
  );
}

function Value({ name, value, path }: { name: string; value: Json; path: Path }) {
  const unit = UNIT.exec(name)?.[1] ?? "", label = name.replace(UNIT, "").replace(/_/g, " ");
  if (!Array.isArray(value)) return typeof value === "number" ? <NumberField path={path} label={label} unit={unit} /> : <Leaf node={{}} path={path} label={label} />;
  const parts = value.length === 3 ? PLACE : name === "size_mm" ? SIZE : LIMITS;
  return <>{value.map((_, k) => <NumberField key={k} path={[...path, k]} label={`${label} ${parts[k]}`} unit={unit} />)}</>;
}
