// The layout in space, by the module that turns it in reports.

import { useEffect, useRef } from "preact/hooks";
import "../../../tailstack_service/report/templates/viewer.css";
import "../../../tailstack_service/report/templates/viewer.js";
import { drawn, layout } from "../api";
import { design, pointed, selected } from "../state";

interface LayoutViewer {
  update(scene: unknown): void;
  point(label: string | null): void;
}
declare global {
  interface Window {
    LayoutViewer: new (figure: HTMLElement, scene: unknown, number: number) => LayoutViewer;
  }
}

export function Space() {
  const figure = useRef<HTMLElement>(null), viewer = useRef<LayoutViewer | null>(null), scene = layout.value?.scene, marked = pointed.value ?? selected.value;
  useEffect(() => {
    if (!scene || !figure.current) return;
    if (viewer.current) viewer.current.update(scene);
    else viewer.current = new window.LayoutViewer(figure.current, scene, 1);
  }, [scene]);
  useEffect(() => viewer.current?.point(marked), [scene, marked]);
  useEffect(() => figure.current!.addEventListener("point", (event) => (pointed.value = (event as CustomEvent<string | null>).detail)), []);
  return <figure ref={figure} hidden={!scene} class={drawn.value === design.value ? "space" : "space old"} />;
}
