/* Begins the client of a machine in a thread of its own: the page sends its code first. */
self.onmessage = ({ data }) => {
  wasm_bindgen.initSync({ module: data });
  wasm_bindgen.start_worker();
};
