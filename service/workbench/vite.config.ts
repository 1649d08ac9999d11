// Builds the page into the Python package, from which the service serves it: users need no Node.
import { defineConfig } from "vite";

const service = "http://127.0.0.1:8321";
const toService = { target: service, changeOrigin: true, headers: { origin: service } }; // it refuses what another page sends

export default defineConfig({
  base: "./",
  build: {
    outDir: "../tailstack_service/workbench",
    emptyOutDir: true,
    assetsInlineLimit: 0, // the policy of the page allows no script or style inside the document
    modulePreload: { polyfill: false },
    target: "es2022",
    reportCompressedSize: true,
  },
  server: { proxy: { "/v1": toService, "/version": toService, "/docs": toService } },
});
