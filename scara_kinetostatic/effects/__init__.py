"""Physical effects that the twelve parameters lack, one file each; `registry` lists them."""
