/* Where the page's data comes from: the file itself, or a feed.

Both sources have one interface. A message is an object with one or more of these keys:

  stage   the run's constants, as in docs/scene.md. A stage of another run empties the page.
  frames  a list of frames, in the order of ticks. A frame of a tick that the page has replaces it.
  status  what is known of the run as a whole; keys that are left out stay as they were:
            state     "waiting" (no run yet, or a recording that is being read), "running", or
                      "ended" (no frame will follow)
            text      one line for people, or ""
            complete  false if a recording was cut off before the end of its run
            beliefs   false if beliefs were not worked out
            missed_ticks  how many ticks a viewer that came late has not seen
            control   true if this page may change the radio (page/control.js)

A recording that was written into the file stands in <script type="application/json" id="recording">
as base64 of the gzip of one such message.

The feed is a WebSocket at ws://HOST/feed with JSON text messages, both ways. After each connection
the page first sends {"resume": {"run": NAME or null, "from": TICK}}: the run that it shows and the
tick after the last one that it has. The feed answers with the stage, with all frames from that tick on
(from 0 on if it has another run) and with the status. Whatever a control sends goes to
source.send(object).

The server serves index.html at "/", and beside it the files of this folder and Bokeh's two
scripts, under their own names. */
"use strict";

(function (page) {
  const RETRY_MS_MIN = 500;
  const RETRY_MS_MAX = 8000;

  /* The recording in the file; null if there is none. */
  function embeddedText() {
    const element = document.getElementById("recording");
    const text = element ? element.textContent.trim() : "";
    return text || null;
  }

  async function unpacked(base64) {
    const packed = Uint8Array.from(atob(base64), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }

  /* Data that stands in the file itself. */
  class EmbeddedSource {
    constructor(base64) {
      this.live = false;
      this.base64 = base64;
    }

    /* Calls take(message) with all there is, then connection("embedded"). */
    start(take, connection) {
      return unpacked(this.base64).then((text) => {
        take(JSON.parse(text));
        connection("embedded");
      });
    }

    /* Nobody listens: false. */
    send() {
      return false;
    }
  }

  /* Data that a server sends while the page is open. */
  class FeedSource {
    constructor(address, position) {
      this.live = true;
      this.address = address;
      this.position = position;
      this.socket = null;
      this.retryMs = RETRY_MS_MIN;
      this.attempts = 0;
    }

    /* Calls take(message) for each message, and connection(state) with "connecting", "open" or
       "lost", as often as it changes. */
    start(take, connection) {
      this.take = take;
      this.connection = connection;
      this.connect();
      return Promise.resolve();
    }

    connect() {
      this.attempts += 1;
      this.connection(this.attempts === 1 ? "connecting" : "lost");
      const socket = new WebSocket(this.address);
      this.socket = socket;
      socket.onopen = () => {
        this.retryMs = RETRY_MS_MIN;
        socket.send(JSON.stringify({ resume: this.position() }));
        this.connection("open");
      };
      socket.onmessage = (event) => this.take(JSON.parse(event.data));
      socket.onclose = () => {
        this.socket = null;
        this.connection("lost");
        setTimeout(() => this.connect(), this.retryMs);
        this.retryMs = Math.min(2 * this.retryMs, RETRY_MS_MAX);
      };
    }

    /* Sends an object to the server; whether there was a connection to send it on. */
    send(object) {
      if (!this.socket || this.socket.readyState !== WebSocket.OPEN) return false;
      this.socket.send(JSON.stringify(object));
      return true;
    }
  }

  /* The source of this page; position() says which run and tick a feed should go on from. */
  page.sourceOf = function (position) {
    const base64 = embeddedText();
    if (base64) return new EmbeddedSource(base64);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    return new FeedSource(`${scheme}://${location.host}/feed${location.search}`, position);
  };
})((window.encirclePage = window.encirclePage || {}));
