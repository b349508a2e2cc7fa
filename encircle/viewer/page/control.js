/* The radio in the reader's hand: what this page may change in a run that it watches.

page.mountControl(element, source, model) is called once, when a status says that this page may
change the radio. It fills the element, and sends by source.send(object). It hears each later
message if it adds a function to model.listeners. */
"use strict";

(function (page) {
  page.mountControl = page.mountControl || null;
})((window.encirclePage = window.encirclePage || {}));
