"""What a command says and draws: rows, sentences and the scene, a file each; its flags are in cli."""
