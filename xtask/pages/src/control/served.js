/* Begins the page that the local program serves, which has the machine: a worker checks programs alone. */

async function start() {
  const file = await fetch('page.wasm');
  const module = await WebAssembly.compile(await file.arrayBuffer());
  wasm_bindgen.initSync({ module });
  wasm_bindgen.start_page(module, 'worker.js', 'program');
  document.body.dataset.ready = 'yes';
}

start().catch((error) => {
  document.getElementById('loading').textContent = `The page does not run in this browser: ${error.message}`;
});
