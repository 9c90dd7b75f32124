"""``tca activities``: an application in the browser, live."""
