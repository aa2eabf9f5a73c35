/* Begins the control page: loads the code that is in it, here and in the worker. */

const textOf = (id) => document.getElementById(id).textContent;

/** The bytes of a pack: `deflate-raw`, written as base64. */
async function unpack(id) {
  const bytes = Uint8Array.from(atob(textOf(id)), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream('deflate-raw'));
  return new Response(stream).arrayBuffer();
}

/** The glue as a script of the page, which makes `wasm_bindgen`. */
function load(text) {
  const script = document.createElement('script');
  script.textContent = text;
  document.head.append(script);
}

async function start() {
  const module = await WebAssembly.compile(await unpack('wasm'));
  load(textOf('glue'));
  wasm_bindgen.initSync({ module });
  const parts = [textOf('glue'), textOf('worker')];
  const address = URL.createObjectURL(new Blob(parts, { type: 'text/javascript' }));
  wasm_bindgen.start_page(module, address, '');
  document.body.dataset.ready = 'yes';
}

start().catch((error) => {
  document.getElementById('loading').textContent = `The page does not run in this browser: ${error.message}`;
});
