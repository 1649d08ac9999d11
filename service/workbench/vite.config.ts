// Builds the page into the Python package, from which the service serves it: users need no Node.
import { createHash } from "node:crypto";
import { readFileSync, writeFileSync } from "node:fs";
import { relative } from "node:path";
import { fileURLToPath } from "node:url";
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

/** What was read and what came of it, each file of `service/` with its SHA-256, in `built.json`: a test compares. */
function record(): Plugin {
  const service = fileURLToPath(new URL("..", import.meta.url));
  const pins = ["package.json", "package-lock.json", "tsconfig.json", "vite.config.ts"].map((name) => fileURLToPath(new URL(name, import.meta.url)));
  return {
    name: "record",
    apply: "build",
    writeBundle({ dir }, bundle) {
      const read = [...this.getModuleIds()].map((id) => id.split("?")[0]).filter((id) => id.startsWith(service) && !id.includes("/node_modules/"));
      const files = new Set([...pins, ...read, ...Object.keys(bundle).map((name) => `${dir}/${name}`)]);
      const digests = [...files].map((file) => [relative(service, file), createHash("sha256").update(readFileSync(file)).digest("hex")]);
      writeFileSync(`${dir}/built.json`, `${JSON.stringify(Object.fromEntries(digests.sort()), null, 1)}\n`);
    },
  };
}

export default defineConfig({
  plugins: [licences(), record()],
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
