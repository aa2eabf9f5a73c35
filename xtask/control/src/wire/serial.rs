//! A serial port by Web Serial, which Chrome and Edge have.

use std::{cell::RefCell, rc::Rc};

use js_sys::{Array, Object, Promise, Reflect, Uint8Array};
use wasm_bindgen::{
    JsCast as _,
    prelude::{JsValue, wasm_bindgen},
};
use wasm_bindgen_futures::{JsFuture, spawn_local};
use web_sys::{ReadableStreamDefaultReader, WritableStreamDefaultWriter};

use super::{Wire, socket::Inbox};
use crate::worker;

/// Bytes that the browser keeps until they are read: a worker that is late loses none.
const BUFFER_BYTES: u32 = 1 << 16;
/// Errors by which only bytes are lost: the port stays open, and has a new stream.
const LOST_BYTES: [&str; 4] = [
    "BufferOverrunError",
    "BreakError",
    "FramingError",
    "ParityError",
];

#[wasm_bindgen]
extern "C" {
    /// `navigator.serial`.
    type SerialPorts;
    #[wasm_bindgen(method, js_name = getPorts)]
    fn ports(this: &SerialPorts) -> Promise;
    #[wasm_bindgen(method, js_name = requestPort)]
    fn request(this: &SerialPorts) -> Promise;

    #[derive(Clone)]
    type Port;
    #[wasm_bindgen(method)]
    fn open(this: &Port, options: &Object) -> Promise;
    #[wasm_bindgen(method)]
    fn close(this: &Port) -> Promise;
    #[wasm_bindgen(method, getter)]
    fn readable(this: &Port) -> web_sys::ReadableStream;
    #[wasm_bindgen(method, getter)]
    fn writable(this: &Port) -> web_sys::WritableStream;
}

/// `navigator.serial`, where the browser has it.
fn serial() -> Option<SerialPorts> {
    let navigator = Reflect::get(&js_sys::global(), &"navigator".into()).ok()?;
    let serial = Reflect::get(&navigator, &"serial".into()).ok()?;
    (!serial.is_undefined()).then(|| serial.unchecked_into())
}

/// Whether the browser has Web Serial.
pub(crate) fn has_serial() -> bool {
    serial().is_some()
}

/// Has the operator choose a port: which of those that the page may use, and how many these are.
pub(crate) async fn choose_port() -> Option<(u32, u32)> {
    let serial = serial()?;
    let chosen = JsFuture::from(serial.request()).await.ok()?;
    let ports = JsFuture::from(serial.ports()).await.ok()?;
    let ports: Array = ports.unchecked_into();
    let index = ports.index_of(&chosen, 0).try_into().ok()?;
    Some((index, ports.length()))
}

/// A port, once it is open.
#[derive(Default)]
struct Opened {
    inbox: Inbox,
    writer: Option<WritableStreamDefaultWriter>,
    reader: Option<ReadableStreamDefaultReader>,
    /// The line was dropped, perhaps before the port was open.
    is_dropped: bool,
}

/// A serial port.
pub(super) struct Serial {
    opened: Rc<RefCell<Opened>>,
    unsent: Vec<u8>,
}

impl Serial {
    pub(super) fn open(port: (u32, u32), baud: u32) -> Self {
        let opened = Rc::new(RefCell::new(Opened::default()));
        let of_task = opened.clone();
        spawn_local(async move {
            let failure = match run(&of_task, port, baud).await {
                Ok(()) => "the serial port is closed".into(),
                Err(error) => format!("the serial port cannot be used: {}", sentence(&error)),
            };
            of_task.borrow_mut().inbox.failure = Some(failure);
        });
        Self {
            opened,
            unsent: Vec::new(),
        }
    }
}

/// What a browser, or this module, says of an error.
fn sentence(error: &JsValue) -> String {
    let message = Reflect::get(error, &"message".into()).ok();
    let text = message.and_then(|message| message.as_string());
    text.or_else(|| error.as_string())
        .unwrap_or_else(|| format!("{error:?}"))
}

/// Opens a port, and reads it to its end.
async fn run(
    opened: &RefCell<Opened>,
    (index, count): (u32, u32),
    baud: u32,
) -> Result<(), JsValue> {
    let serial = serial().ok_or("this browser has no Web Serial: use Chrome or Edge")?;
    let ports = JsFuture::from(serial.ports()).await?;
    let ports: Array = ports.unchecked_into();
    if ports.length() != count || index >= count {
        return Err("it is not plugged in, or others are: choose it again".into());
    }
    let port: Port = ports.get(index).unchecked_into();
    let options = Object::new();
    Reflect::set(&options, &"baudRate".into(), &baud.into())?;
    Reflect::set(&options, &"bufferSize".into(), &BUFFER_BYTES.into())?;
    JsFuture::from(port.open(&options)).await?;
    {
        let mut opened = opened.borrow_mut();
        opened.writer = Some(port.writable().get_writer()?);
        opened.inbox.is_open = true;
    }
    let end = read(opened, &port).await;
    let writer = opened.borrow_mut().writer.take();
    if let Some(writer) = writer {
        // What was sent last, perhaps the end of a jog, is written before.
        let _ = JsFuture::from(writer.close()).await;
        writer.release_lock();
    }
    // One whose cable is out is closed already.
    let _ = JsFuture::from(port.close()).await;
    end
}

/// Reads until the port is closed.
async fn read(opened: &RefCell<Opened>, port: &Port) -> Result<(), JsValue> {
    loop {
        let reader: ReadableStreamDefaultReader = port.readable().get_reader().unchecked_into();
        opened.borrow_mut().reader = Some(reader.clone());
        let end = read_stream(opened, &reader).await;
        reader.release_lock();
        let only_loses_bytes = end.as_ref().is_err_and(loses_bytes);
        if !only_loses_bytes || opened.borrow().is_dropped {
            return end;
        }
    }
}

/// Whether the port is still open after an error.
fn loses_bytes(error: &JsValue) -> bool {
    let name = Reflect::get(error, &"name".into()).ok();
    let name = name.and_then(|name| name.as_string());
    name.is_some_and(|name| LOST_BYTES.contains(&&*name))
}

/// Reads a stream to its end.
async fn read_stream(
    opened: &RefCell<Opened>,
    reader: &ReadableStreamDefaultReader,
) -> Result<(), JsValue> {
    while !opened.borrow().is_dropped {
        let piece = JsFuture::from(reader.read()).await?;
        if Reflect::get(&piece, &"done".into())?.is_truthy() {
            break;
        }
        let bytes: Uint8Array = Reflect::get(&piece, &"value".into())?.unchecked_into();
        opened.borrow_mut().inbox.bytes.extend(bytes.to_vec());
        worker::receive();
    }
    Ok(())
}

impl Wire for Serial {
    fn exchange(&mut self, output: &[u8], _: u64) -> Result<Vec<u8>, String> {
        self.unsent.extend(output);
        let mut opened = self.opened.borrow_mut();
        if let Some(writer) = &opened.writer
            && !self.unsent.is_empty()
        {
            let bytes = Uint8Array::from(self.unsent.as_slice());
            let written = writer.write_with_chunk(&bytes);
            // A port that is gone says so where it is read.
            spawn_local(async move {
                let _ = JsFuture::from(written).await;
            });
            self.unsent.clear();
        }
        opened.inbox.take()
    }
}

impl Drop for Serial {
    fn drop(&mut self) {
        let mut opened = self.opened.borrow_mut();
        opened.is_dropped = true;
        if let Some(reader) = opened.reader.take() {
            let cancelled = reader.cancel();
            spawn_local(async move {
                let _ = JsFuture::from(cancelled).await;
            });
        }
    }
}
