// Builds the page into the Python package, from which the service serves it: users need no Node.
import { createHash } from "node:crypto";
import { readFileSync } from "node:fs";
import { defineConfig, type Plugin } from "vite";

const service = "http://127.0.0.1:8321";
const toService = { target: service, changeOrigin: true, headers: { origin: service } }; // it refuses what another page sends

/** The licence texts of every package that the lock file installs for the page, in one file that the page links to. */
function licences(): Plugin {
  const here = (path: string) => new URL(path, import.meta.url);
  const { packages } = JSON.parse(readFileSync(here("package-lock.json"), "utf8")) as { packages: Record<string, { version: string; license?: string; dev?: boolean }> };
  const parts = Object.entries(packages).filter(([path, { dev }]) => path && !dev).map(([path, { version, license }]) =>
    `${path.replace(/^.*node_modules\//, "")} ${version} (${license})\n\n${readFileSync(here(`${path}/LICENSE`), "utf8").trim()}\n`);
  const source = `The page of the workbench contains the following packages, each under its licence.\n\n${parts.join(`\n${"-".repeat(80)}\n\n`)}`;
  const fileName = `assets/licences-${createHash("sha256").update(source).digest("hex").slice(0, 8)}.txt`;
  return {
    name: "licences",
    apply: "build",
    generateBundle() {
      this.emitFile({ type: "asset", fileName, source });
    },
    transformIndexHtml: () => [{ tag: "link", attrs: { rel: "license", type: "text/plain", href: `./${fileName}` }, injectTo: "head" }],
  };
}

export default defineConfig({
  plugins: [licences()],
  base: "./",
  build: {
    outDir: "../tailstack_service/workbench",
    emptyOutDir: true,
    assetsInlineLimit: 0, // the policy of the page allows no script or style inside the document
    modulePreload: { polyfill: false },
    target: "es2022",
    reportCompressedSize: true,
  },
  server: { proxy: { "/v1": toService, "/version": toService, "/docs": toService, "/manual": toService } },
});
